"""What a core input is solved for: ages, offsets and past actions, with numbers by hand."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from gymnasium.wrappers import FlattenObservation, FrameStackObservation, TransformObservation

from tests.envs.own import STACKS, PreviousAction, pendulum
from transferkit import derive_spec, load_core, vary, wrap
from transferkit.errors import ConfigError
from transferkit.matching import angle_pairs, compiled, pair
from transferkit.pairing import Copy
from transferkit.policy.base import ConstantPolicy
from transferkit.policy.health import health

ONE, CARTPOLE, CHEETAH = "InvertedPendulum-v5", "dm_control/cartpole-balance-v0", "HalfCheetah-v5"


def inputs(source, target):
    """Of each core input its bias and the terms it is a combination of, by the target's names and pairs."""
    match = compiled(pair(source, target), source, target)
    names = [element.name for element in target.observation] + list(zip(match.sin, match.cos, strict=True))
    rows = zip(source.observation, match.weight, match.bias, strict=True)
    return {
        element.name: (
            pytest.approx(bias),
            {name: pytest.approx(w, rel=1e-5) for name, w in zip(names, weight, strict=True) if w},
        )
        for element, weight, bias in rows
    }


def test_a_sine_belongs_to_the_cosine_of_its_own_time():
    """Five elements a frame: x, cos, sin, two velocities."""
    spec = derive_spec(f"{CARTPOLE}?vary.frames=3")
    assert angle_pairs(spec) == [(2, 1), (7, 6), (12, 11)]
    assert inputs(derive_spec(ONE), spec)["hinge_y.position"] == (0.0, {(12, 11): 1.0})


def test_what_is_added_to_a_velocity_is_taken_off():
    def standardised():
        return TransformObservation(pendulum(), lambda x: (x - [0.1, 0.2, 0.3, 0.4]) / 2, Box(-np.inf, np.inf, (4,)))

    found = inputs(derive_spec(ONE), derive_spec(standardised))
    assert found["hinge_y.position"] == (0.2, {"hinge_y.position": 2.0})
    assert found["slide_x.velocity"] == (0.3, {"slide_x.velocity": 2.0})
    assert found["hinge_y.velocity"] == (0.4, {"hinge_y.velocity": 2.0})


def with_bounds(spec, low, high):
    return replace(spec, action=tuple(replace(actuator, low=low, high=high) for actuator in spec.action))


def test_a_force_is_counted_from_zero_whatever_the_middle_of_the_bounds():
    """An action of 1 is 3 from the middle: of -3 to 3, of 0 to 6 (-1 does nothing), and of 1.5 to 7.5 (no action does)."""
    core = load_core("inverted-pendulum-v1")
    target = with_bounds(core.spec, 0.0, 6.0)
    match = compiled(pair(core.spec, target), core.spec, target)
    assert (match.action_weight, match.action_bias) == (((1.0,),), (-1.0,))
    assert compiled(pair(target, core.spec), target, core.spec).action_bias == (1.0,)
    assert compiled(pair(target, target), target, target).action_bias == ()
    seen = torch.tensor([[0.1, 0.02, -0.3, 0.2]])
    own, shifted = (wrap(core, spec)(seen)[0] for spec in (core.spec, target))
    torch.testing.assert_close(shifted, own - 1.0)
    assert "action drive.slide_x = +1 drive.slide_x -1\n" in wrap(core, target).describe()
    undriven = replace(pair(core.spec, target), copies=(Copy({"hinge_y": {"hinge_y": 1.0}}, {}),))
    for bounds, nothing in (((0.0, 6.0), -1.0), ((1.5, 7.5), -1.0), ((-1.5, 4.5), -0.5), ((-3.0, 3.0), None)):
        arrays = compiled(undriven, core.spec, with_bounds(core.spec, *bounds))
        assert arrays.action_bias == (() if nothing is None else (nothing,))


def test_the_past_is_as_long_ago_as_for_the_core():
    """A step of the core is three of the target's: x(t - 3) = x(t) + 3 (x(t - 1) - x(t))."""
    target = derive_spec(f"{ONE}?vary.frames=2")
    source = replace(target, time_step=3 * target.time_step)
    assert inputs(source, target)["hinge_y.position[t-1]"] == (0.0, {"hinge_y.position[t-1]": 3, "hinge_y.position": -2})
    assert inputs(source, source)["hinge_y.position[t-1]"] == (0.0, {"hinge_y.position[t-1]": 1})
    assert inputs(source, derive_spec(ONE))["hinge_y.position[t-1]"] == (0.0, {})  # one frame has no past


def test_a_past_action_is_what_the_core_would_have_done():
    """With half the gear the core does twice as much; the pendulum's actions are -3 to 3 in either."""
    made = STACKS["previous action"][0]
    found = inputs(derive_spec(made), derive_spec(vary(made, gear=0.5)))
    assert found["drive.slide_x.action"] == (0.0, {"drive.slide_x.action": 0.5})  # to six digits of the gear
    assert inputs(derive_spec(made), derive_spec(ONE))["drive.slide_x.action"] == (0.0, {})
    other = with_bounds(derive_spec(made), 0.0, 6.0)  # whose force is the same number
    assert inputs(derive_spec(made), other)["drive.slide_x.action"] == (0.0, {"drive.slide_x.action": 1.0})


def test_a_past_action_is_as_old_in_time():
    """In steps of half the time what was done one step ago was done two steps ago."""

    def acted(frame_skip, frames):
        return FlattenObservation(FrameStackObservation(PreviousAction(gymnasium.make(ONE, frame_skip=frame_skip)), frames))

    source, target = derive_spec(lambda: acted(4, 2)), derive_spec(lambda: acted(2, 3))
    found = inputs(source, target)
    assert found["drive.slide_x.action[t-1]"] == (0.0, {"drive.slide_x.action[t-2]": 1.0})
    assert found["drive.slide_x.action"] == (0.0, {"drive.slide_x.action": 1.0})


def test_a_core_that_holds_its_actions_holds_them_as_long_elsewhere():
    held = replace(derive_spec(ONE), hold=4)
    half = replace(held, time_step=held.time_step / 2, hold=1)
    assert [pair(held, target).hold for target in (held, half)] == [4, 8]
    assert pair(half, held).hold == 1


def test_how_a_match_is_found_is_not_asked_where_one_is_given_or_none_is_looked_for():
    core = load_core("inverted-pendulum-v1")
    given = pair(core.spec, derive_spec(CARTPOLE))
    for name, value in {"hold": 5, "limbs": "all", "angles": "own", "forces": "load", "stagger": 0.1}.items():
        with pytest.raises(ConfigError, match=rf"{name}.* has no effect on a .*match.* that is given"):
            wrap(core, CARTPOLE, match=given, **{name: value})
    assert wrap(core, CARTPOLE, match=replace(given, hold=5)).hold == 5
    for adapter in ("random", "pad"):
        with pytest.raises(ConfigError, match=r"hold.* has no effect on .*adapter"):
            wrap(core, CARTPOLE, adapter=adapter, hold=5)
    with pytest.raises(ConfigError, match=r"hold.* has no effect: nothing in Reacher-v5 means"):
        wrap(core, "Reacher-v5", hold=5)


def test_a_policy_without_a_network_is_not_measured():
    with pytest.raises(ConfigError, match="ConstantPolicy has no network"):
        health(ConstantPolicy(4, 1), ONE, steps=20)


def test_a_policy_that_answers_nan_is_not_measured():
    policy = wrap(load_core("inverted-pendulum-v1"), CARTPOLE)
    next(policy.output_adapter.parameters()).data.fill_(float("nan"))
    with pytest.raises(ConfigError, match="answers NaN or infinity"):
        health(policy, CARTPOLE, steps=20)


def test_small_numbers_keep_their_digits():
    def in_degrees():
        env, scale = gymnasium.make(ONE), np.array([1.0, 1.0, 0.00123, 0.00057])
        return TransformObservation(env, lambda x: x * scale, Box(-np.inf, np.inf, (4,)))

    assert [e.coefficients for e in derive_spec(in_degrees).observation] == [(1.0,), (1.0,), (0.00123,), (0.00057,)]
