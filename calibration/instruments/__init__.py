"""What instruments read of a machine: reflectors in a station's frame, coordinates of the tool, distances."""
