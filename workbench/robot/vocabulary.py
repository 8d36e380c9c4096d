"""The words that e-puck users know from pyePuck and ePuckVRep, one method each; what they do is in
``robot.api``.

Contract: readings are those of the last ``step``; every device that a back-end lacks raises
NotSupported.
"""

from abc import ABC, abstractmethod

from workbench.robot.range_bearing import DATA_BYTES, Heard, four_bytes


class Words(ABC):
    """Readings and devices by name."""

    number: int  # which robot of a formation it is
    most_counts = 2**53  # what a step counter can be set to; 16 bits over a wire

    @abstractmethod
    def reading(self, sensor: str) -> tuple[float, ...]:
        """Return what a sensor read at the last step."""

    @abstractmethod
    def _device(self, device: str, *values: int) -> None:
        """Set a device."""

    @abstractmethod
    def set_motors_speed(self, left: int, right: int) -> None:
        """Set the wheel speeds in whole steps/s, at once."""

    def get_proximity(self) -> tuple[float, ...]:
        """Return ps0 … ps7 in counts, near is large; calibrated if the robot has been."""
        return self.reading("proximity")

    def get_light_sensor(self) -> tuple[float, ...]:
        """Return the ambient reading of the same eight sensors: about 4000 counts in the dark,
        falling with light.
        """
        return self.reading("light")

    def get_floor_sensors(self) -> tuple[float, ...]:
        """Return the three ground sensors, left, centre, right, in counts."""
        return self.reading("floor")

    def get_motor_speed(self) -> tuple[float, ...]:
        """Return the commanded wheel speeds in steps/s, as the firmware echoes them; nobody
        measures.
        """
        return self.reading("motor_speed")

    def get_motor_position(self) -> tuple[float, ...]:
        """Return the wheels' step counters, counted on where the wire's 16 bits wrap."""
        return self.reading("motor_position")

    def get_accelerometer(self) -> tuple[float, ...]:
        """Return the raw x, y, z of the accelerometer."""
        return self.reading("accelerometer")

    def get_microphone(self) -> tuple[float, ...]:
        """Return the microphones' volumes."""
        return self.reading("microphone")

    def get_gyroscope(self) -> tuple[float, ...]:
        """Return the raw x, y, z of the gyroscope."""
        return self.reading("gyroscope")

    def get_magnetometer(self) -> tuple[float, ...]:
        """Return x, y, z of the magnetometer in µT."""
        return self.reading("magnetometer")

    def get_distance_sensor(self) -> tuple[float, ...]:
        """Return what the time-of-flight sensor in front measures, in mm."""
        return self.reading("distance")

    def get_temperature(self) -> tuple[float, ...]:
        """Return the temperature of the motion sensor in whole °C."""
        return self.reading("temperature")

    def get_button(self) -> tuple[float, ...]:
        """Return 1 while the button is pressed, 0 otherwise."""
        return self.reading("button")

    def get_remote(self) -> tuple[float, ...]:
        """Return toggle bit, address and key of the last infrared remote command."""
        return self.reading("remote")

    def get_age(self) -> tuple[float, ...]:
        """Return how old the readings were when they were taken, in s: the time since their packet
        began to come in.
        """
        return self.reading("age")

    def get_range_bearing(self) -> tuple[Heard, ...]:
        """Return the messages that a range-and-bearing board has heard since the last step, see
        ``robot.range_bearing``.
        """
        told = self.reading("range_bearing")
        return tuple(
            Heard(told[k], told[k + 1], int(told[k + 2]).to_bytes(DATA_BYTES))
            for k in range(0, len(told), 3)
        )

    def send(self, data: bytes) -> None:
        """Send one to four bytes by the range-and-bearing board, to everybody in its range."""
        self._device("send", *four_bytes(data))

    def get_selector(self) -> tuple[float, ...]:
        """Return the position of the selector switch."""
        return self.reading("selector")

    def get_battery(self) -> tuple[float, ...]:
        """Return the battery: 1 good, 0 low (e-puck1), raw counts (e-puck2)."""
        return self.reading("battery")

    @abstractmethod
    def stop(self) -> None:
        """Stop both wheels, and make sure that they stand."""

    @abstractmethod
    def step(self) -> bool:
        """Let one control period pass and read all enabled sensors."""

    @abstractmethod
    def get_sercom_version(self) -> str:
        """Return what the robot says it is."""

    @property
    def version(self) -> str:
        """What the robot says it is."""
        return self.get_sercom_version()

    def startsim(self) -> bool:
        """Return True: a simulation, or a robot, runs once it is connected (ePuckVRep's word)."""
        return True

    def stepsim(self) -> bool:
        """Same as ``step`` (ePuckVRep's word)."""
        return self.step()

    def stopsim(self) -> None:
        """Same as ``stop`` (ePuckVRep's word)."""
        self.stop()

    def set_sound(self, sound: int) -> None:
        """Play one of the robot's sounds, 1 to 5."""
        self._device("sound", sound)

    def set_accelerometer_filtered(self, filtered: bool = False) -> None:
        """Choose between raw and filtered acceleration, where a robot has both."""
        self._device("accelerometer_filter", int(filtered))

    def set_camera_parameters(self, mode: str, width: int, height: int, zoom: int) -> None:
        """Set what pictures of the robot's own camera are like."""
        self._device("camera", width, height, zoom)

    def get_camera_parameters(self) -> tuple[float, ...]:
        """Return what pictures of the robot's own camera are like."""
        self._device("camera")
        return ()

    def get_image(self) -> None:
        """Take a picture with the robot's own camera."""
        self._device("camera")

    def save_image(self, name: str = "ePuck.jpg") -> None:
        """Store a picture of the robot's own camera."""
        self._device("camera")

    def set_motor_position(self, left: int, right: int) -> None:
        """Set the wheels' step counters; over a wire they have 16 bits."""
        for name, value in (("left", left), ("right", right)):
            if (
                isinstance(value, bool)
                or not isinstance(value, int)
                or abs(value) > self.most_counts
            ):
                raise ValueError(
                    f"{name} = {value!r}; expected a whole number of motor steps, up to "
                    f"±{self.most_counts}"
                )
        self._device("motor_position", left, right)

    def set_led(self, led: int, value: int) -> None:
        """Set one of the eight ring lights: 0 off, 1 on, 2 toggle; another number than 0 to 7 sets
        all.
        """
        self._device("led", led, value)

    def set_body_led(self, value: int) -> None:
        """Set the body light."""
        self._device("body_led", value)

    def set_front_led(self, value: int) -> None:
        """Set the front light."""
        self._device("front_led", value)

    def calibrate_proximity_sensors(self) -> None:
        """Take the mean of 100 readings as every sensor's zero.

        Nothing may stand near the robot.
        """
        self._device("calibrate")

    def observe(self) -> tuple[float, float]:
        """Return distance in m and bearing in rad of the robot in front, as an overhead camera
        tells them.
        """
        distance, bearing = self.reading("observe")
        return distance, bearing
