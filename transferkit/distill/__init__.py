"""A student on other observations from a teacher that has its own."""

from transferkit.distill.distillation import Distilled, distill
from transferkit.distill.recipe import Recipe

__all__ = ["Distilled", "Recipe", "distill"]
