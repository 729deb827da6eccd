"""What breaks first: a catalogue of hard cases, each judged against an independent reference."""
