"""The live page: a server on this machine, and the page that plays a trace while it grows or after it was recorded."""
