"""The physics, written once: kinematics, and one function for each term of the weak form."""
