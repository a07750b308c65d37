"""The pages in the browser: live runs, recorded runs, and the world editor."""
