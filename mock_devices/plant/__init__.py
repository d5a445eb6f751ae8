"""The one machine behind all mock devices: its true geometry, elasticity, temperatures and sight lines."""

__all__ = [
    "affected_machine",
    "any_plant",
    "atmosphere",
    "base_plant",
    "elastic_batch",
    "history_plant",
    "motion_history",
    "noise",
    "optics",
    "plant",
    "sight_lines",
    "spatial_draw",
    "spatial_effects",
    "spatial_equilibrium",
    "spatial_machine",
    "spatial_plant",
    "structure",
    "thermal",
    "true_machine",
    "truth",
]
