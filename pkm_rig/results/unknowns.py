"""What kinds of unknowns are called when people are told of them."""

WORDS = {
    "strut_length": "length of the struts (arms)",
    "axis_tilt": "leaning axes (rails)",
    "drive_scale": "drive scale",
    "platform_joint": "joints on the platform",
    "base_joint": "joints on the base",
    "pivot": "pivots",
    "guide_position": "places of the guides",
    "guide_tilt": "tilts of the guides",
    "ln_stiffness": "stiffness",
    "bar.length": "zero of the distances",
    "bar.scale": "scale of the distances",
    "ball": "place of the ball",
    "frame": "frame of the instrument",
    "offset.z": "offset of the heights",
}


def in_words(kind: str) -> str:
    """What a kind of unknown is called."""
    return WORDS.get(kind, kind)
