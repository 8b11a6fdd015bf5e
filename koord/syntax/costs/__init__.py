"""What a program costs to run: how much work, storage and depth. Too much is an error."""

from koord.syntax.costs.limits import MOST_PARTS, excesses
from koord.syntax.costs.work import MOST_DEEP, MOST_STEPS

__all__ = ["MOST_DEEP", "MOST_PARTS", "MOST_STEPS", "excesses"]
