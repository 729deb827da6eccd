"""From measured data in files to a state, quantities and a report."""
