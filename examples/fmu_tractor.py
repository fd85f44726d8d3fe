# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Drive a tractor in a closed loop: its transmission is an FMU, which FMPy runs.

    python examples/fmu_tractor.py

The tractor ploughs in stage HM2 and speeds up from 6 to 8 km/h; after 6 s the soil gets heavier. A
controller sets the displacement ratio, a governor the engine torque. Engine and vehicle have
inertia, the tyres slip; the transmission is a steady map, as the exported model is. Vehicle and
controllers are invented.

Python computes nothing of the transmission: the FMU does. At the end its answers are compared with
those of the Python model at the same inputs.
"""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import hmcvt_core as hmcvt
import hmcvt_tools

STAGE = "HM2"
STEP = 0.01  # s
DURATION = 12.0  # s
SOIL_CHANGE = 6.0  # s

MASS = 8000.0  # kg
GRAVITY = 9.81  # m/s2
TYRE_RADIUS = 0.85  # m
FINAL_DRIVE = 21.0
TYRE_STIFFNESS = 5.0 * MASS * GRAVITY  # N per slip
ROLLING = 0.06 * MASS * GRAVITY  # N
DRAUGHT = 12e3  # N, of the plough in the light soil
HEAVIER = 6e3  # N, more in the heavy soil

ENGINE_INERTIA = 2.0  # kg m2
ENGINE_SPEED = 170.0  # rad/s, which the governor holds
GOVERNOR = 40.0  # N m s/rad
STROKE_GAIN = 1.2  # displacement ratio per m/s and s

OUTPUTS = ("efficiency", "output_speed", "engine_torque", "power_loss", "status")


class Transmission:
    """An FMU 2.0 for co-simulation, by names of its variables."""

    def __init__(self, path: Path) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave

        description = fmpy.read_model_description(str(path))
        self._references = {
            variable.name: variable.valueReference
            for variable in description.modelVariables
        }
        self._folder = fmpy.extract(str(path))
        self._unit = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self._folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="transmission",
        )
        self._unit.instantiate()
        self._unit.setupExperiment(startTime=0.0)
        self._unit.enterInitializationMode()
        self._unit.exitInitializationMode()

    def engage(self, stage: int) -> None:
        """Engage a stage by its number in the parameter file, from 0."""
        self._unit.setInteger([self._references["stage"]], [stage])

    def answer(
        self, time: float, stroke: float, engine_speed: float, load_torque: float
    ) -> dict[str, float]:
        """Set the inputs, take a step from a time, and return the outputs."""
        names = ("displacement_ratio", "engine_speed", "load_torque")
        references = [self._references[name] for name in names]
        self._unit.setReal(references, [stroke, engine_speed, load_torque])
        self._unit.doStep(time, STEP)
        values = {}
        for name in OUTPUTS[:-1]:
            values[name] = self._unit.getReal([self._references[name]])[0]
        values["status"] = self._unit.getInteger([self._references["status"]])[0]
        return values

    def close(self) -> None:
        """Free the FMU and its folder."""
        self._unit.terminate()
        self._unit.freeInstance()
        shutil.rmtree(self._folder)


@dataclass
class Tractor:
    """State of the tractor between two steps."""

    speed: float = 6.0 / 3.6  # m/s
    wheel_speed: float = 6.0 / 3.6  # m/s, of the circumference
    engine_speed: float = ENGINE_SPEED
    stroke: float = -0.6
    engine_energy: float = 0.0  # J
    output_energy: float = 0.0  # J
    lost_energy: float = 0.0  # J

    def tyre_force(self) -> float:
        """Return the force of the tyres on the ground [N]."""
        slip = (self.wheel_speed - self.speed) / max(abs(self.wheel_speed), 0.1)
        return TYRE_STIFFNESS * slip

    def load_torque(self) -> float:
        """Return output power / engine speed [N m]."""
        return self.tyre_force() * self.wheel_speed / self.engine_speed


def wanted_speed(time: float) -> float:
    """Return the ground speed that the driver wants [m/s]."""
    return float(np.interp(time, [1.0, 4.0], [6.0 / 3.6, 8.0 / 3.6]))


def advance(
    tractor: Tractor, engine: hmcvt.Engine, time: float, answer: dict[str, float]
) -> None:
    """Take one step of engine, vehicle and controller with the answer of the transmission."""
    # First what the answer belongs to: load and speed of the beginning of the step.
    power = tractor.load_torque() * tractor.engine_speed
    tractor.engine_energy += answer["engine_torque"] * tractor.engine_speed * STEP
    tractor.output_energy += power * STEP
    tractor.lost_energy += answer["power_loss"] * STEP

    resistance = ROLLING + DRAUGHT
    if time >= SOIL_CHANGE:
        resistance += HEAVIER
    tractor.speed += STEP * (tractor.tyre_force() - resistance) / MASS
    tractor.wheel_speed = answer["output_speed"] * TYRE_RADIUS / FINAL_DRIVE

    full_load = float(engine.full_load_torque(tractor.engine_speed))
    asked = GOVERNOR * (ENGINE_SPEED + 5.0 - tractor.engine_speed)
    torque = min(max(asked, 0.0), full_load)
    surplus = torque - answer["engine_torque"]
    tractor.engine_speed += STEP * surplus / ENGINE_INERTIA

    # In HM2 a higher displacement ratio turns the output faster.
    tractor.stroke += STEP * STROKE_GAIN * (wanted_speed(time) - tractor.speed)
    tractor.stroke = min(max(tractor.stroke, -1.0), 1.0)


def drive(
    transmission: Transmission, engine: hmcvt.Engine, tractor: Tractor
) -> np.ndarray:
    """Run the loop; return the inputs and outputs of the FMU at every step."""
    rows = []
    for number in range(round(DURATION / STEP) + 1):
        time = number * STEP
        inputs = (tractor.stroke, tractor.engine_speed, tractor.load_torque())
        answer = transmission.answer(time, *inputs)
        if answer["status"] != 0:
            raise SystemExit(f"fmu_tractor: no answer at {time:.2f} s, inputs {inputs}")
        if number % round(1.0 / STEP) == 0:
            show(time, tractor, answer)
        rows.append((*inputs, answer["efficiency"], answer["output_speed"]))
        advance(tractor, engine, time, answer)
    return np.array(rows)


def show(time: float, tractor: Tractor, answer: dict[str, float]) -> None:
    """Print one line of the course."""
    print(
        f"{time:4.0f} {3.6 * wanted_speed(time):9.2f} {3.6 * tractor.speed:9.2f} "
        f"{tractor.engine_speed * 30.0 / np.pi:9.0f} {tractor.stroke:9.3f} "
        f"{100.0 * answer['efficiency']:9.1f} {answer['power_loss'] / 1e3:9.2f}"
    )


def main() -> None:
    """Export the FMU, drive, and compare its answers with Python."""
    model = hmcvt.load_model(hmcvt.data_path("params/tractor.yaml"))
    engine = hmcvt.load_engine(hmcvt.data_path("params/engine.yaml"))
    tractor = Tractor()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tractor.fmu"
        try:
            hmcvt_tools.export_fmu(model, path)
        except hmcvt.InputError as error:
            raise SystemExit(f"fmu_tractor: {error}") from None
        transmission = Transmission(path)
        try:
            transmission.engage(list(model.stages).index(STAGE))
            print(
                "   s    wanted    driven    engine    stroke  efficiency    loss\n"
                "          km/h      km/h     r/min         -         %      kW"
            )
            rows = drive(transmission, engine, tractor)
        finally:
            transmission.close()
    part = model.stages[STAGE]
    python = np.column_stack(
        [part.efficiency(*rows[:, :3].T), part.output_speed(*rows[:, :3].T)]
    )
    print(
        f"energy: engine {tractor.engine_energy / 1e3:.1f} kJ, output "
        f"{tractor.output_energy / 1e3:.1f} kJ, lost {tractor.lost_energy / 1e3:.1f} kJ"
    )
    print(
        f"largest difference between FMU and Python at {len(rows)} steps: "
        f"{np.abs(rows[:, 3:] - python).max():g}"
    )


if __name__ == "__main__":
    main()
