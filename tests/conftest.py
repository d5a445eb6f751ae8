"""Loaded before any test loads numpy: linear algebra on one thread, as for the command; one profile of Hypothesis."""

import hypothesis

import pkm_rig

assert pkm_rig.__version__

# Every run tries the same cases, however long one takes, and keeps no examples on disk.
hypothesis.settings.register_profile("pkm_rig", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("pkm_rig")
