"""The demonstration: its files, and the chapters that `youbot demo` shows."""
