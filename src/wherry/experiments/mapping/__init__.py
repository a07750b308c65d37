"""The tables of maps beside published figures."""
