"""wherry: robots that find out by themselves how their world works, and then deliver."""

__version__ = "0.1.0"
