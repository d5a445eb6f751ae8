"""What a diagnosis says: where the gap lies, how large its causes are, how far it shrinks, what to measure next."""

__all__ = [
    "effect_summary",
    "folder_remarks",
    "further_columns",
    "next_measurement",
    "parameter_uncertainty",
    "proposals",
    "remarks",
    "variance_shares",
    "withheld_blocks",
]
