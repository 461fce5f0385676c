"""A scripted picamera2: a Pi 4 with an imx219, of which the calls that picamera2_pipe.py makes are answered as the manual says.

Controls act three frames late, the exposure is cut to whole lines, digital gain is added, and the metadata says what was really used.
Environment: SCRIPTED_RAW is the raw format that the configuration grants in place of the one that is asked for.
"""
import os
import struct
import time

LINE_US = 32.0
MODES = [
    {"format": "SRGGB10_CSI2P", "unpacked": "SRGGB10", "size": (640, 480), "crop_limits": (1000, 752, 1280, 960)},
    {"format": "SRGGB10_CSI2P", "unpacked": "SRGGB10", "size": (3280, 2464), "crop_limits": (0, 0, 3280, 2464)},
    {"format": "SRGGB10_CSI2P", "unpacked": "SRGGB10", "size": (64, 48), "crop_limits": (0, 0, 3280, 2464)},
]


class Request:
    def __init__(self, code, metadata, size, stride):
        self.metadata, self.released = metadata, False
        width, height = size
        row = struct.pack("<H", code) * width
        self.raw = (row + bytes(stride - len(row))) * height

    def get_metadata(self):
        return dict(self.metadata)

    def make_buffer(self, name):
        assert name == "raw" and not self.released
        return self.raw

    def release(self):
        self.released = True


class Picamera2:
    sensor_modes = MODES

    def __init__(self):
        self.pending, self.started = [10000.0] * 3, False

    def create_video_configuration(self, raw, controls, buffer_count):
        assert not controls["AeEnable"] and not controls["AwbEnable"] and controls["AnalogueGain"] == 1.0
        assert buffer_count > 3 and controls["FrameDurationLimits"][0] > 33000
        return {"raw": raw}

    def configure(self, configuration):
        size = configuration["raw"]["size"]
        name = os.environ.get("SCRIPTED_RAW", configuration["raw"]["format"])
        self.raw = {"format": name, "size": size, "stride": 2 * size[0] + 32}

    def camera_configuration(self):
        return {"raw": self.raw}

    def start(self):
        self.started = True

    def stop(self):
        self.started = False

    def set_controls(self, controls):
        self.wished = float(controls["ExposureTime"])

    def capture_request(self):
        assert self.started
        self.pending.append(self.wished)
        us = int(int(self.pending.pop(0) / LINE_US) * LINE_US)
        code = 64 + min(959, us // 40)
        metadata = {
            "ExposureTime": us,
            "AnalogueGain": 1.0,
            "DigitalGain": 1.25,
            "SensorTimestamp": time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 1000000,
            "SensorBlackLevels": (4096, 4096, 4096, 4096),
        }
        return Request(code, metadata, self.raw["size"], self.raw["stride"])
