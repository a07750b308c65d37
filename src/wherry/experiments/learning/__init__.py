"""The tables of learners beside published figures."""
