"""The processes of one run under mpirun, and the seconds by kind of work."""
