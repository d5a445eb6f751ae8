"""Protocol servers around one simulated machine: laser station, servo drives, PLC.

Written without `calibration`, `drivers` and `pkm_rig`, so that agreement with them means something.
"""
