"""Parts: parametric solids (link, slider), solids from STEP files, materials, mass properties."""
