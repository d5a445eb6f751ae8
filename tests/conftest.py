"""Loaded before any test loads numpy: linear algebra on one thread, as the command has it."""

import pkm_rig

assert pkm_rig.__version__
