"""Pictures, pages and progress for people; they consume traces and nothing else."""
