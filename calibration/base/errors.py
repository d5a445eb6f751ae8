"""What is wrong with something that was given."""


class InputError(ValueError):
    """An invalid file, measurement or choice: one line that states what is wrong, where, and what to do."""
