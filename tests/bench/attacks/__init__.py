"""Attacks on the built programs, by attacker: each a function that attacks, proves that it did, and says what held."""
