"""The forward model against solutions by formula; `python -m tests.verification` writes docs/verification.md anew."""
