"""What users bring: their own models in their own environments, and stacks of wrappers."""

import gymnasium
import mujoco
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.spaces import Box, Dict
from gymnasium.wrappers import (
    Autoreset,
    DelayObservation,
    FilterObservation,
    FlattenObservation,
    FrameStackObservation,
    NormalizeObservation,
    RescaleAction,
    TimeAwareObservation,
    TransformObservation,
)

PENDULUM = "InvertedPendulum-v5"

ARM = """
<mujoco><worldbody>
  <body><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1"/>
    <body><joint name="turn" axis="0 1 0" damping=".1"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/></body></body>
</worldbody>{}</mujoco>"""

MODELS = {
    "motors": ARM.format('<actuator><motor joint="lift" ctrlrange="-2 3"/><motor joint="turn" ctrlrange="-1 1"/></actuator>'),
    "two motors on one joint": ARM.format(
        '<actuator><motor joint="turn" ctrlrange="-1 1"/><motor joint="turn" gear="-3" ctrlrange="-1 1"/></actuator>'
    ),
    "position": ARM.format(
        '<actuator><position joint="lift" kp="50" ctrlrange="-1 1"/><velocity joint="turn" kv="2" ctrlrange="-4 4"/></actuator>'
    ),
    "filtered": ARM.format(
        '<actuator><general joint="turn" dyntype="filter" dynprm=".1" gainprm="7" ctrlrange="-1 1"/></actuator>'
    ),
    "integrated": ARM.format('<actuator><intvelocity joint="turn" kp="5" actrange="-1 1" ctrlrange="-1 1"/></actuator>'),
    "tendon": ARM.format(
        '<tendon><fixed name="both"><joint joint="lift" coef="1"/><joint joint="turn" coef=".5"/></fixed></tendon>'
        '<actuator><motor tendon="both" ctrlrange="-1 1"/></actuator>'
    ),
    "muscle": ARM.format('<actuator><muscle joint="turn" ctrlrange="0 1" lengthrange=".1 1"/></actuator>'),
    "ball": """<mujoco><worldbody><body><joint name="hip" type="ball"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".05"/>
        <body pos="0 0 -.4"><joint name="knee" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -.4" size=".04"/></body>
        </body></worldbody><actuator><motor joint="knee" ctrlrange="-1 1"/></actuator></mujoco>""",
    "drone": """<mujoco><option gravity="0 0 -1"/><worldbody><body pos="0 0 1"><freejoint/><geom type="box" size=".1 .1 .02"/>
        <site name="a" pos=".1 0 0"/><site name="b" pos="-.1 0 0"/></body></worldbody><actuator>
        <motor site="a" gear="0 0 1 0 0 0" ctrlrange="0 4"/>
        <motor site="b" gear="0 0 1 0 0 0" ctrlrange="0 4"/></actuator></mujoco>""",
    "mocap": ARM.format('<actuator><motor joint="turn" ctrlrange="-1 1"/></actuator>').replace(
        "<worldbody>",
        '<worldbody><body name="hand" mocap="true" pos="1 0 0"><geom size=".05" contype="0" conaffinity="0"/></body>',
    ),
    "mesh": ARM.format('<actuator><motor joint="lift" ctrlrange="-1 1"/></actuator>')
    .replace("<worldbody>", '<asset><mesh name="wedge" vertex="0 0 0 .2 0 0 0 .2 0 0 0 .2"/></asset><worldbody>')
    .replace('<geom size=".1"/>', '<geom type="mesh" mesh="wedge"/>'),
    "closed loop": """<mujoco><worldbody><body name="a"><joint name="one" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".03"/></body>
        <body name="b" pos=".3 0 0"><joint name="two" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".03"/></body></worldbody>
        <equality><joint joint1="one" joint2="two"/></equality>
        <actuator><motor joint="one" ctrlrange="-1 1"/></actuator></mujoco>""",
    "contacts": """<mujoco><worldbody><geom type="plane" size="5 5 .1"/>
        <body pos="0 0 .4"><joint name="z" type="slide" axis="0 0 1"/><geom size=".1"/>
        <body><joint name="leg" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 -.3" size=".04"/></body></body>
        </worldbody><actuator><motor joint="leg" gear="5" ctrlrange="-1 1"/></actuator></mujoco>""",
}


class Plain(gymnasium.Env):
    """A `gymnasium.Env` around a model and data under other names, without `dt`; its step has five physics steps."""

    def __init__(self, xml, scale=1.0):
        self.robot, self.scale = mujoco.MjModel.from_xml_string(xml), scale
        self.state = mujoco.MjData(self.robot)
        self.action_space = Box(*self.robot.actuator_ctrlrange.T.astype(np.float32))
        self.observation_space = Box(-np.inf, np.inf, (self.robot.nq + self.robot.nv,))

    def _observe(self):
        return np.concatenate([self.state.qpos, self.state.qvel])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.robot, self.state)
        self.state.qvel[:] = self.np_random.uniform(-0.1, 0.1, self.robot.nv)
        return self._observe(), {}

    def step(self, action):
        self.state.ctrl[:] = self.scale * action
        mujoco.mj_step(self.robot, self.state, 5)
        return self._observe(), 1.0, False, False, {}


class NeedsAnAction(MujocoEnv):
    """A `MujocoEnv` whose `_get_obs` has an argument."""

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"], "render_fps": 50}  # noqa: RUF012

    def __init__(self, path):
        super().__init__(str(path), 10, Box(-np.inf, np.inf, (6,)))

    def _get_obs(self, action):
        return np.concatenate([self.data.qpos, self.data.qvel, action])

    def reset_model(self):
        self.set_state(self.init_qpos, self.init_qvel)
        return self._get_obs(np.zeros(2))

    def step(self, action):
        self.do_simulation(action, self.frame_skip)
        return self._get_obs(action), 0.0, False, False, {}


class PreviousAction(gymnasium.Wrapper):
    """Appends the action to the observation."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = Box(-np.inf, np.inf, (env.observation_space.shape[0] + env.action_space.shape[0],))

    def reset(self, **named):
        observation, info = self.env.reset(**named)
        return np.concatenate([observation, np.zeros(self.action_space.shape)]), info

    def step(self, action):
        observation, *rest = self.env.step(action)
        return (np.concatenate([observation, action]), *rest)


class Noise(gymnasium.ObservationWrapper):
    """Adds noise from a generator of its own."""

    def __init__(self, env, deviation):
        super().__init__(env)
        self.rng, self.deviation = np.random.default_rng(0), deviation

    def observation(self, observation):
        return observation + self.rng.normal(0, self.deviation, observation.shape)


class Proportional:
    """Noise in proportion to what is observed."""

    def __init__(self):
        self.rng = np.random.default_rng(0)

    def __call__(self, observation):
        return observation * (1 + 0.02 * self.rng.normal(size=observation.shape))


class UnseededNoise(gymnasium.ObservationWrapper):
    """Adds noise that nothing can hold still; every so often it is the same twice in a row."""

    def __init__(self, env, seed=None, same_every=None):
        super().__init__(env)
        self.draw, self.same_every, self.noise, self.count = np.random.default_rng(seed).normal, same_every, 0.0, 0

    def observation(self, observation):
        self.count += 1
        if self.same_every is None or self.count % self.same_every:
            self.noise = self.draw(0, 0.002, observation.shape)
        return observation + self.noise


class LowPass(gymnasium.ObservationWrapper):
    """Mixes what is with what was."""

    last = 0.0

    def observation(self, observation):
        self.last = 0.5 * self.last + 0.5 * observation
        return self.last


class AsDict(gymnasium.ObservationWrapper):
    """Observes a dictionary."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = Dict({"where": Box(-np.inf, np.inf, (2,)), "how fast": Box(-np.inf, np.inf, (2,))})

    def observation(self, observation):
        return {"where": observation[:2].astype(np.float32), "how fast": observation[2:].astype(np.float32)}


class Repeat(gymnasium.Wrapper):
    """Repeats an action."""

    def step(self, action):
        for _ in range(4):
            answer = self.env.step(action)
        return answer


class Scaled(gymnasium.ActionWrapper):
    """Scales, turns or clips an action."""

    def __init__(self, env, factor=1.0, most=np.inf):
        super().__init__(env)
        self.factor, self.most = factor, most

    def action(self, action):
        return np.clip(self.factor * action, -self.most, self.most)


class Servo(Plain):
    """Turns an action into the torques that lead to a position."""

    def step(self, action):
        return super().step(2 * (action - self.state.qpos) - self.state.qvel)


class Pushed(Plain):
    """Pushes its joints without actuators."""

    def step(self, action):
        self.state.qfrc_applied[:] = 3 * (action - 1)
        return super().step(0 * action)


class Adding(Plain):
    """Moves its controls by an action from where they are."""

    def step(self, action):
        self.state.ctrl[:] = np.clip(self.state.ctrl + 0.02 * action, -1, 1)
        mujoco.mj_step(self.robot, self.state, 5)
        return self._observe(), 1.0, False, False, {}


class Mean(gymnasium.ActionWrapper):
    """Acts by the mean of the last actions."""

    def __init__(self, env, count):
        super().__init__(env)
        self.last = [np.zeros(env.action_space.shape)] * count

    def action(self, action):
        self.last = [*self.last[1:], action]
        return np.mean(self.last, axis=0)


class NoisyAction(gymnasium.ActionWrapper):
    """Adds noise to an action."""

    def action(self, action):
        return action + self.np_random.normal(0, 0.05, action.shape)


class WaitsForTheClock(Plain):
    """Steps until a time has come."""

    def step(self, action):
        self.state.ctrl[:] = action
        end = self.state.time + 0.02
        while self.state.time < end:
            mujoco.mj_step(self.robot, self.state)
        return self._observe(), 1.0, False, False, {}


class Strict(Plain):
    """Allows no step after the end of an episode, and ends it where the arm is not upright."""

    over = False

    def reset(self, **named):
        self.over = False
        return super().reset(**named)

    def step(self, action):
        if self.over:
            raise RuntimeError("the episode is over")
        observation, reward, *_ = super().step(action)
        self.over = bool(abs(self.state.qpos[1]) > 0.2)
        return observation, reward, self.over, False, {}


class Clocks(gymnasium.Wrapper):
    """Appends the simulated time, a phase of it, and the integral of the cart's position."""

    def __init__(self, env):
        super().__init__(env)
        self.observation_space = Box(-np.inf, np.inf, (7,))
        self.integral = 0.0

    def reset(self, **named):
        observation, info = self.env.reset(**named)
        self.integral = 0.0
        return self._with_clocks(observation), info

    def step(self, action):
        observation, *rest = self.env.step(action)
        self.integral += observation[0] * 0.04
        return (self._with_clocks(observation), *rest)

    def _with_clocks(self, observation):
        time = self.unwrapped.data.time
        return np.concatenate([observation, [time, np.cos(2 * np.pi * time), self.integral]])


class LowPassAction(gymnasium.ActionWrapper):
    """Mixes what is done with what was."""

    last = 0.0

    def action(self, action):
        self.last = 0.5 * self.last + 0.5 * action
        return self.last


def pendulum():
    return gymnasium.make(PENDULUM)


POSITIONS = ("slide_x.position", "hinge_y.position")
VELOCITIES = ("slide_x.velocity", "hinge_y.velocity")
WHOLE = (*POSITIONS, *VELOCITIES)


def _old(names, age):
    return tuple(f"{name}[t-{age}]" for name in names)


STACKS = {
    "frames": (lambda: FlattenObservation(FrameStackObservation(pendulum(), 3)), (*_old(WHOLE, 2), *_old(WHOLE, 1), *WHOLE)),
    "previous action": (lambda: PreviousAction(pendulum()), (*WHOLE, "drive.slide_x.action")),
    "frames with actions": (
        lambda: FlattenObservation(FrameStackObservation(PreviousAction(pendulum()), 2)),
        (*_old((*WHOLE, "drive.slide_x.action"), 1), *WHOLE, "drive.slide_x.action"),
    ),
    "dictionary": (lambda: FlattenObservation(AsDict(pendulum())), (*VELOCITIES, *POSITIONS)),
    "filter": (lambda: FlattenObservation(FilterObservation(AsDict(pendulum()), ["how fast"])), VELOCITIES),
    "normalised": (lambda: NormalizeObservation(pendulum()), WHOLE),
    "time": (lambda: TimeAwareObservation(pendulum()), (*WHOLE, "observation[4]")),
    "noise": (lambda: Noise(pendulum(), 0.002), WHOLE),
    "much noise": (lambda: Noise(pendulum(), 0.2), WHOLE),
    "noise without a seed": (lambda: UnseededNoise(pendulum()), WHOLE),
    "noise that repeats itself": (lambda: UnseededNoise(pendulum(), seed=0, same_every=16), WHOLE),
    "noise in proportion": (lambda: TransformObservation(pendulum(), Proportional(), None), WHOLE),
    "clocks": (lambda: Clocks(pendulum()), (*WHOLE, "observation[4]", "observation[5]", "observation[6]")),
    "delay": (lambda: DelayObservation(pendulum(), 2), _old(WHOLE, 2)),
    "units": (lambda: TransformObservation(pendulum(), lambda row: 2 * row + 1, None), WHOLE),
    "low pass": (lambda: LowPass(pendulum()), ("qpos[0]", "qpos[1]", "qvel[0]", "qvel[1]")),
    "automatic reset": (lambda: Autoreset(pendulum()), WHOLE),
    "rescaled": (lambda: RescaleAction(pendulum(), -1, 1), WHOLE),
}
"""Makers of wrapper stacks, and the names of the elements that come out."""
