"""Pictures along a path: what moves how, rendered or read again, played to the nodes."""
