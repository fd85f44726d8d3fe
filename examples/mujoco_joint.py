# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Diagnose a robot joint that MuJoCo simulates (pip install mujoco).

    python examples/mujoco_joint.py

A servo swings a hanging arm as a sine of some amplitude and frequency. The bench reads the motor
torque in phase with the position and with the speed, and the amplitude of an encoder at the arm.
The model knows mass and centre of the arm. A campaign with Coulomb friction is simulated and
diagnosed.
"""

import copy

import mujoco
import numpy as np
from mujoco import rollout

import hmcvt_core as hmcvt

XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="rotor">
      <joint name="motor" axis="0 1 0" armature="0.02" damping="0.2"
             solreffriction="0.004 1"/>
      <inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/>
      <body name="arm">
        <joint name="play" axis="0 1 0" limited="true" range="-1e-6 1e-6" damping="0.2"
               solreflimit="0.004 1" solimplimit="0.5 0.99 0.003"/>
        <inertial pos="0 0 -0.3" mass="2" diaginertia="0.004 0.004 0.004"/>
      </body>
    </body>
  </worldbody>
  <actuator><position name="servo" joint="motor" kp="3000" kv="60"/></actuator>
  <sensor>
    <actuatorfrc actuator="servo"/><jointpos joint="motor"/><jointpos joint="play"/>
  </sensor>
</mujoco>
"""
JOINT_MODEL = mujoco.MjModel.from_xml_string(XML)
NOISE = {"torque_position": 0.03, "torque_speed": 0.03, "arm_amplitude": 0.0005}
CYCLES = 1.25  # the first quarter lets the start die away
UNITS = {"torque_position": "N m", "torque_speed": "N m", "arm_amplitude": "rad"}


def swing(
    points: hmcvt.Points,
    *,
    mass: float,
    centre: float,
    coulomb_friction: float = 0.0,
    viscous_friction: float = 0.0,
    armature: float = 0.0,
    backlash: float = 0.0,
    encoder_gain: float = 0.0,
) -> dict[str, hmcvt.Array]:
    """Return the amplitudes that the bench reads at n points, shape (n,) each.

    Args:
        points: `amplitude` [rad] and `frequency` [Hz] of the motor, shape (n,) each.
        mass: of the arm [kg].
        centre: distance of its centre of mass from the joint [m].
        coulomb_friction: of the motor [N m].
        viscous_friction: of the motor, more than known [N m s/rad].
        armature: inertia of the rotor, more than known [kg m2].
        backlash: play between motor and arm [rad].
        encoder_gain: relative error of the encoder at the arm.
    """
    model = copy.copy(JOINT_MODEL)
    model.body("arm").mass[:] = mass
    model.body("arm").ipos[2] = -centre
    model.dof_frictionloss[0] = coulomb_friction
    model.dof_damping[0] += viscous_friction
    model.dof_armature[0] += armature
    half_play = max(0.5 * backlash, 1e-6)
    model.joint("play").range[:] = (-half_play, half_play)
    mujoco.mj_setConst(model, mujoco.MjData(model))

    amplitude, frequency = points["amplitude"], points["frequency"]
    step = model.opt.timestep
    steps = int(np.ceil(CYCLES / frequency.min() / step))
    time = step * np.arange(1, steps + 1)
    phase = 2.0 * np.pi * frequency[:, None] * time
    start = np.zeros((len(amplitude), 5))  # time, two positions, two speeds
    start[:, 1] = amplitude
    command = amplitude[:, None, None] * np.cos(phase)[..., None]
    _, read = rollout.rollout(model, mujoco.MjData(model), start, command)
    torque, motor, play = np.moveaxis(read, 2, 0)

    # Amplitudes by least squares over the last cycle, which is no whole number of steps.
    cycles = frequency[:, None] * time
    used = (cycles > CYCLES - 1.0) & (cycles <= CYCLES)
    shapes = np.stack([np.cos(phase), -np.sin(phase), np.ones_like(phase)], axis=1)
    inverse = np.linalg.pinv(shapes * used[:, None])
    torque_position, torque_speed, _ = np.einsum("nts,nt->sn", inverse, torque)
    arm_amplitude = np.einsum("nts,nt->sn", inverse, motor + play)[0]
    return {
        "torque_position": torque_position,
        "torque_speed": torque_speed,
        "arm_amplitude": (1.0 + encoder_gain) * arm_amplitude,
    }


def switch(name: str, unit: str, typical: float, low: float, high: float, part: str):
    """Return an effect of the joint."""
    return hmcvt.Switch(name, unit, typical, low, high, component=part)


JOINT = hmcvt.Simulator(
    function=swing,
    axes=(hmcvt.Axis.of("amplitude", "rad"), hmcvt.Axis.of("frequency", "Hz")),
    channels=tuple(hmcvt.Channel.of(name, UNITS[name], NOISE[name]) for name in NOISE),
    parameters=(
        hmcvt.Parameter("mass", "kg", 2.0, 0.05, low=1.5, high=2.5),
        hmcvt.Parameter("centre", "m", 0.30, 0.005, low=0.25, high=0.35),
    ),
    effects=(
        switch("coulomb_friction", "N m", 0.3, 0.0, 3.0, "motor"),
        switch("viscous_friction", "N m s/rad", 0.1, 0.0, 2.0, "motor"),
        switch("armature", "kg m2", 0.01, 0.0, 0.2, "motor"),
        switch("backlash", "rad", 0.01, 0.0, 0.1, "gear"),
        switch("encoder_gain", "-", 0.01, -0.1, 0.1, "sensor"),
    ),
)


def campaign(
    seed: int, tests: int = 20, **hidden: float
) -> tuple[dict[str, hmcvt.Array], dict[str, hmcvt.Array]]:
    """Return operating points and readings of a simulated joint with hidden effects."""
    rng = np.random.default_rng(seed)
    points = {
        "amplitude": rng.uniform(0.1, 0.6, tests),
        "frequency": rng.uniform(1.2, 2.5, tests),
    }
    mass = 2.0 + 0.03 * rng.standard_normal()
    centre = 0.30 + 0.003 * rng.standard_normal()
    true = swing(points, mass=mass, centre=centre, **hidden)
    noisy = {k: true[k] + NOISE[k] * rng.standard_normal(tests) for k in NOISE}
    return points, noisy


if __name__ == "__main__":
    points, readings = campaign(seed=1, coulomb_friction=0.2)
    observed = hmcvt.observe_system(JOINT, {**points, **readings}, noise=NOISE)
    print(hmcvt.diagnose_system(JOINT, observed).report())
