"""The parts of tests/e2e/closed_loop.py."""
