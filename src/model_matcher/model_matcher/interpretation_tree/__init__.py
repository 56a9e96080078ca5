"""The thesis' searches: tables of constraints, trees, subgraphs, on this machine and on the array machine."""
