"""What follows from stored results: causes of SAWSS, tube laws, flow in one dimension, transmission of the load."""
