"""CAN: from the frames of a bus to one strain vector per cycle of the load cells."""
