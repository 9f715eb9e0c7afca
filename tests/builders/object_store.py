"""An object store that speaks S3, on loopback: moto's server, which a real client of S3 asks."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

BUCKET = "talus-test"


@contextmanager
def an_s3_server() -> Iterator[str]:
    """The URL of a folder in an empty bucket; what a client needs to know stands in the environment meanwhile."""
    from moto.server import ThreadedMotoServer
    from s3fs import S3FileSystem

    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    known = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
        # The server is on this machine, whatever the way out is.
        "NO_PROXY": "127.0.0.1",
    }
    with patch.dict(os.environ, known):
        S3FileSystem.clear_instance_cache()
        S3FileSystem().mkdir(BUCKET)
        try:
            yield f"s3://{BUCKET}/plant"
        finally:
            S3FileSystem.clear_instance_cache()
            server.stop()
