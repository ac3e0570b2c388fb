"""The whole robot: screws, elastic elements in series and parallel, the Biglide, gravity, workspace maps."""
