"""What a command does, from the rig or the store to a result."""
