"""What a run tells: its records, as bytes, and as files."""
