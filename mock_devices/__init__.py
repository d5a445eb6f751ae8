"""Protocol servers around one simulated machine: station, servo drives, PLC.

Written without `calibration`, `drivers` and `pkm_rig`, so that agreement with them means something.
"""
