"""Our robot and our agent as nodes."""
