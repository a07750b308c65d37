"""Space in metres and radians: poses, grids and rays (paper, section 7)."""
