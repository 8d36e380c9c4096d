"""Drives: how faithfully a robot's wheels are simulated, one file each; ``table`` lists them."""
