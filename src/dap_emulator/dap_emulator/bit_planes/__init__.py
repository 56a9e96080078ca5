"""Arithmetic of one-bit processing elements: microprograms on bit-planes, which count the instructions they take."""
