"""Parameters, skin motion and waveforms from measurements."""
