import pytest

from transferkit.budget import Budget, Spent
from transferkit.errors import ConfigError, SettingError


def test_a_budget_needs_a_limit():
    with pytest.raises(ConfigError, match="no budget given; give episodes, steps or seconds"):
        Budget()


@pytest.mark.parametrize("limits", [{"episodes": 0}, {"steps": -1}, {"seconds": 0.0}, {"seconds": float("nan")}], ids=str)
def test_a_limit_is_positive(limits):
    with pytest.raises(SettingError, match=f"^{next(iter(limits))}=.* must be a"):
        Budget(**limits)


def test_the_first_limit_reached_ends_training():
    budget = Budget(episodes=10, steps=100)
    assert Spent(episodes=3, steps=50).fraction(budget) == 0.5
    assert Spent(episodes=9, steps=50).step_fraction(budget) == 0.5
    assert Spent(episodes=9, steps=50).step_fraction(Budget(episodes=10)) == 0.9
    assert not Spent(episodes=9, steps=99).exhausts(budget)
    assert Spent(episodes=10, steps=20).exhausts(budget)
    assert Spent(episodes=1, steps=100).exhausts(budget)
