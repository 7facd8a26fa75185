"""Parameters of materials from measurements: uniaxial tests, and areas in images of a section."""
