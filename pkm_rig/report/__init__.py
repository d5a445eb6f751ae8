"""What people and programs see of a result: terminal, HTML, pictures, JSON."""

__all__ = [
    "axis_json",
    "axis_text",
    "check_text",
    "diagnosis_json",
    "diagnosis_pictures",
    "diagnosis_text",
    "homing_text",
    "html",
    "identified_text",
    "interim_text",
    "left_out_text",
    "measured_text",
    "notation",
    "outcome_json",
    "outcome_text",
    "pictures",
    "plan_text",
    "record_text",
    "tables_text",
    "terminal",
]
