"""The machine as its file describes it, and its mechanics: poses at rest, drives for poses, derivatives."""

__all__ = [
    "carriers",
    "description",
    "equilibrium",
    "inverse",
    "led_path",
    "machine_file",
    "measured_poses",
    "mechanics",
    "sensitivity",
]
