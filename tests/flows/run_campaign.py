"""The command line with an invented calibration, also in the worker processes, which import this file anew."""

import os
import sys

sys.path.insert(0, os.environ["FAKE_CODE"])
sys.path.insert(0, os.environ["FAKE_FLOWS"])


def kill_at_random(arguments):
    """Fork campaigns one after the other and kill each at a random moment; print how many were killed and ended."""
    import random
    import signal
    import time

    import threadpoolctl  # noqa: E401, F401

    from flows import cli

    points, limit = int(arguments[0]), float(arguments[1])
    source, killed, ended = random.Random(7), 0, 0
    while killed < points:
        child = os.fork()
        if child == 0:
            sys.argv = ["gravcal", *arguments[2:]]
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            cli.main()
        time.sleep(source.uniform(0.0, limit))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        killed += os.WIFSIGNALED(status)
        if os.WIFEXITED(status):
            ended += 1
            fresh(ended)
    sys.stdout.write(f"{killed} {ended}\n")


def fresh(number):
    """Go on with an empty store."""
    os.environ["GRAVCAL_PRODUCTS"] = f"{os.environ['GRAVCAL_PRODUCTS'].partition('+')[0]}+{number}"


def ask_as_strangers():
    """Print whether workers do what they are sent: by their campaign, without TLS, with keys of one's own; their pids.

    The pids are printed when the cluster is closed and waited for.
    """
    import json

    from distributed import Client
    from distributed.security import Security

    from flows import campaign

    with campaign.cluster(campaign.Campaign("fakecal", None), 2) as client:
        pids = list(client.run(os.getpid).values())
        said, address = [client.submit(pow, 2, 3).result()], client.scheduler.address
        for security in (None, Security.temporary()):
            where = address if security else address.replace("tls://", "tcp://")
            try:
                with Client(where, timeout="3s", security=security) as stranger:
                    said.append(stranger.submit(pow, 2, 3).result())
            except OSError:
                said.append("refused")
    sys.stdout.write(json.dumps([said, pids]))


if __name__ == "__main__":
    if sys.argv[1] == "kill":
        kill_at_random(sys.argv[2:])
    elif sys.argv[1] == "strangers":
        ask_as_strangers()
    else:
        from flows.cli import main

        main()
