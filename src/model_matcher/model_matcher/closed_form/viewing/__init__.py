"""Pages of cases, pairs, recordings and live graphs for a browser: the command and what it reads."""
