"""The questions, and what was measured to answer them."""

from workbench.studies.tables import load_study as load_study
