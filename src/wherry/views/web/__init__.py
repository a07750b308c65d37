"""Web pages for live runs, recorded runs and the world editor, and their server."""
