"""The array machine: arrays on a grid of processing elements, their operations, and what each costs in cycles."""
