"""One scene in several variants, side by side in one run: agreement, cost and errors of each."""
