"""Attacks on the built programs, by attacker: each a function that attacks, proves that it did, and reports which defence held."""
