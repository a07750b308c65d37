"""Environments that others have made, seen as OO-MDPs: what they are stays as it is, only the view is ours."""
