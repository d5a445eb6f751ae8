"""The mocks and drivers against other people's programs."""
