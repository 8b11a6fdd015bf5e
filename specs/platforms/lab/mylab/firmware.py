"""What runs on the lab's car, simulated: `python -m mylab.firmware --port 7000`.

It answers `where` with `x y heading speed`, drives by `drive SPEED RATE`, stops when it was told
nothing for half a second, and prints where it is, for `koord conform`.
"""

import argparse
import json
import math
import socket
import time

DEAD_MAN_S, STEP_S = 0.5, 0.01


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=7000)
    parser.add_argument("--start", type=float, nargs=3, default=(0.0, 0.0, 0.0))
    told = parser.parse_args()
    wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    wire.bind(("127.0.0.1", told.port))
    wire.setblocking(False)
    (x, y, heading), speed, rate, wanted, told_s = told.start, 0.0, 0.0, (0.0, 0.0), 0.0
    steps = 0
    while True:
        try:
            while True:
                line, who = wire.recvfrom(200)
                words = line.decode().split()
                if words[0] == "drive":
                    wanted, told_s = (float(words[1]), float(words[2])), time.monotonic()
                else:
                    wire.sendto(f"{x} {y} {heading} {speed}".encode(), who)
        except OSError:
            pass
        goal = wanted if time.monotonic() - told_s < DEAD_MAN_S else (0.0, 0.0)
        speed += max(-0.02, min(0.02, goal[0] - speed))
        rate += max(-0.08, min(0.08, goal[1] - rate))
        heading += rate * STEP_S
        x += speed * math.cos(heading) * STEP_S
        y += speed * math.sin(heading) * STEP_S
        steps += 1
        if steps % 5 == 0:
            print(json.dumps({"east": x, "north": y, "heading": heading}), flush=True)
        time.sleep(STEP_S)


if __name__ == "__main__":
    main()
