"""Many jobs: the options that say who does them, the processes or cluster that do, and what is kept of them."""
