"""A Gauss-Markov process, exact for any step."""
import math


class GaussMarkov:
    def __init__(self, random, sigma, time_constant):
        self.random, self.sigma, self.time_constant = random, sigma, time_constant
        self.value = random.gauss(0, sigma) if sigma > 0 else 0.0

    def step(self, dt):
        keep = math.exp(-dt / self.time_constant)
        self.value = keep * self.value + self.sigma * math.sqrt(1 - keep * keep) * self.random.gauss(0, 1)
        return self.value
