"""What everything else is built on: arrays, checked arguments, names, records."""
