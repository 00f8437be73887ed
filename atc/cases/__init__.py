"""What an `atc pd` case says, builds and runs."""
