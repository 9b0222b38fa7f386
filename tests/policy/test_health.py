import pytest

from transferkit import load_core, wrap
from transferkit.policy.health import health

IDP = "InvertedDoublePendulum-v5"


def test_health_tells_the_papers_sandwich_from_the_default(paper_core, specs):
    """The paper's shared ReLU cuts the core off in about two initialisations of five; the default's never does."""
    core = paper_core
    cut_off = [health(wrap(core, specs[IDP], preset="paper", seed=s), IDP, steps=100).core_gradient == 0 for s in range(20)]
    assert 4 <= sum(cut_off) <= 13
    sick = health(wrap(core, specs["Hopper-v5"], preset="paper", seed=cut_off.index(False)), "Hopper-v5", steps=100)
    assert sick.action_rank <= 1
    assert any("directions" in warning for warning in sick.warnings)
    for seed in range(5):
        well = health(wrap(core, specs["Hopper-v5"], seed=seed), "Hopper-v5", steps=100)
        assert well.core_gradient > 0
        assert well.action_rank == 3
        assert (well.std_low, well.std_high) == pytest.approx((0.6, 0.6))


def test_health_tells_actions_that_exploration_cannot_change():
    """Hanging, the pole is far from what the core has learnt on, so it pushes far beyond full force; upright it is not."""
    stuck, well = (wrap(load_core("inverted-pendulum-v1"), f"dm_control/cartpole-{task}-v0") for task in ("swingup", "balance"))
    sick = health(stuck, "dm_control/cartpole-swingup-v0", steps=200)
    assert sick.saturated > 0.9
    assert any("outside the limits" in warning for warning in sick.warnings)
    assert health(well, "dm_control/cartpole-balance-v0", steps=200).saturated < 0.1
