"""``python -m bayes_ssi``, the command line where its script is not on the path."""

from bayes_ssi.cli import main

if __name__ == "__main__":
    main(prog_name="bayes-ssi")
