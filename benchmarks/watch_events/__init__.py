"""What `recalibrate watch` does when something happens to the machine, its devices, its papers or its computer."""
