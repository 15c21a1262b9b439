"""`python -m musatpy` is `musat`."""

from musatpy.cli.main import main

if __name__ == "__main__":
    main(prog_name="musat")
