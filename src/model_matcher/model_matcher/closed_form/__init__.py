"""Closed-form testing: scenes whose answer is known, through the libraries or the whole graph of nodes."""
