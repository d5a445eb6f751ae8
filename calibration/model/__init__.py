"""What the machine's poses depend on: its parameters, where it stood and what it carried."""
