"""The machine as a service: workspaces of its clients, pictures as input and output, and the client itself."""
