"""The page in a browser: guides through a calibration, by the jobs that the commands run."""

__all__ = [
    "access",
    "actions",
    "control",
    "files",
    "history_view",
    "login_page",
    "machine_view",
    "measure_view",
    "page",
    "page_parts",
    "page_words",
    "rig_view",
    "server",
    "tasks",
    "titles",
    "trend",
    "work",
]
