"""Tests never show progress bars and never write into figures/."""

import os

os.environ["WORKBENCH_STATIC"] = "1"
os.environ["WORKBENCH_QUICK"] = "1"
