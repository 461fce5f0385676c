#!/usr/bin/env python3
"""Writes the raw frames of a Raspberry Pi camera into a pipe for hemilux.

    mkfifo /run/hemilux/frames
    hemilux serve --source pipe:/run/hemilux/frames,lens=lens.toml &
    python3 picamera2_pipe.py /run/hemilux/frames --exposures 0.0009 0.0055 0.0333

Uses the sensor mode that covers most of the sensor. Each frame has the exposure, the gain and the time that libcamera reports for it, so
that the delay of the controls has no effect. "Frame pipe" in board/FORMATS.md defines the header. Needs python3-picamera2.
"""
import argparse
import struct
import sys
import time

from picamera2 import Picamera2

HEADER = struct.Struct("<4sHH4sIIIIHHQQddd")
ORDERS = ("BGGR", "GBRG", "GRBG", "RGGB")
# FourCCs of V4L2 by the end of libcamera's name, in the order of ORDERS.
FOURCCS = {
    "8": ("BA81", "GBRG", "GRBG", "RGGB"),
    "10": ("BG10", "GB10", "BA10", "RG10"),
    "12": ("BG12", "GB12", "BA12", "RG12"),
    "16": ("BYR2", "GB16", "GR16", "RG16"),
    "10_CSI2P": ("pBAA", "pGAA", "pgAA", "pRAA"),
    "12_CSI2P": ("pBCC", "pGCC", "pgCC", "pRCC"),
}


def widest(modes):
    """Returns the mode that covers the largest part of the sensor and, of those, has the fewest pixels."""
    return min(modes, key=lambda m: (-m["crop_limits"][2] * m["crop_limits"][3], m["size"][0] * m["size"][1]))


def packing(name):
    """Returns FourCC and bits of a libcamera format such as SRGGB10_CSI2P."""
    order, kind = name[1:5], name[5:]
    if order not in ORDERS or kind not in FOURCCS:
        sys.exit(f"picamera2_pipe: found the raw format {name}, expected S + one of {ORDERS} + one of {list(FOURCCS)}")
    return FOURCCS[kind][ORDERS.index(order)].encode(), int(kind.split("_")[0])


def frame(request, stream, exposures, sequence):
    """Returns header and bytes of a completed request."""
    told, pixels = request.get_metadata(), request.make_buffer("raw")
    fourcc, bits = packing(stream["format"])
    gain = told["AnalogueGain"] * told.get("DigitalGain", 1.0)
    # libcamera's times are of CLOCK_BOOTTIME, which also counts while the board sleeps.
    asleep = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    stamp = max(told["SensorTimestamp"] - asleep, 0)
    black = told.get("SensorBlackLevels", (0,))[0] * 2.0**bits / 65536.0
    head = HEADER.pack(b"HLXF", 1, HEADER.size, fourcc, *stream["size"], stream["stride"], len(pixels), 0, exposures,
                       sequence, stamp, told["ExposureTime"] / 1e6, gain, black)
    return head, pixels


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("path", help="the FIFO or file")
    parser.add_argument("--exposures", type=float, nargs="+", default=[0.0009, 0.0055, 0.0333], help="seconds")
    parser.add_argument("--frames", type=int, default=0, help="number of frames after which to stop; 0: never")
    options = parser.parse_args()
    camera = Picamera2()
    mode = widest(camera.sensor_modes)
    longest = int(max(options.exposures) * 1e6) + 1000
    manual = {"AeEnable": False, "AwbEnable": False, "AnalogueGain": 1.0, "FrameDurationLimits": (longest, longest)}
    raw = {"format": str(mode["unpacked"]), "size": mode["size"]}
    camera.configure(camera.create_video_configuration(raw=raw, controls=manual, buffer_count=6))
    stream = camera.camera_configuration()["raw"]
    packing(stream["format"])
    sequence = 0
    camera.start()
    while True:
        try:
            with open(options.path, "wb") as pipe:
                while not options.frames or sequence < options.frames:
                    exposure = options.exposures[sequence % len(options.exposures)]
                    camera.set_controls({"ExposureTime": round(exposure * 1e6)})
                    request = camera.capture_request()
                    head, pixels = frame(request, stream, len(options.exposures), sequence)
                    request.release()
                    pipe.write(head)
                    pipe.write(pixels)
                    sequence += 1
            camera.stop()
            return
        except BrokenPipeError:
            print("picamera2_pipe: the reader is gone, waiting for the next one", file=sys.stderr)


if __name__ == "__main__":
    main()
