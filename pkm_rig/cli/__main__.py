"""`python -m pkm_rig.cli` is `pkm-rig`."""

from pkm_rig.cli.entry import main

if __name__ == "__main__":
    main()
