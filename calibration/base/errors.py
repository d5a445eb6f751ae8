"""What is wrong with something that was given."""


class InputError(ValueError):
    """A file, a measurement or a choice that is not fit: one line that says what, where, and what to do."""
