"""Names of the kinds of unknowns, for people."""

KIND_NAMES = {
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
    "bed.bowl": "a bed that is a bowl",
}


def kind_in_words(kind: str) -> str:
    """The name of a kind of unknown."""
    return KIND_NAMES.get(kind, kind)
