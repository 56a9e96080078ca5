"""What every node of the graph shares: parameters, guarded callbacks, diagnostics, stamps, old names and files."""
