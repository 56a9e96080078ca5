"""Emulator of the AMT DAP array processor: bit-plane machine, Fortran-Plus subset, cost model and ROS service node."""
