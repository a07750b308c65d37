"""Learners to compare with: tables, R-max, Factored R-max, Q-learning."""
