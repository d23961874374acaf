#!/usr/bin/python3
"""Errors of kinevox if its TLS settings do not match the server's: they name TLS and the option to use.

usage: connection_errors_test.py KINEVOX KINEVOX-TLS"""
import os
import subprocess
import sys
import tempfile
import unittest
from concurrent import futures
from pathlib import Path

import grpc

KINEVOX_TLS = sys.argv.pop(2)
KINEVOX = sys.argv.pop(1)
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith("KINEVOX_")}


class ConnectionErrors(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = Path(cls.temporary.name)
        subprocess.run([KINEVOX_TLS, "init", "--out", str(cls.folder)], check=True, capture_output=True, timeout=60)
        pair = [((cls.folder / "server-key.pem").read_bytes(), (cls.folder / "server.pem").read_bytes())]
        cls.ca = str(cls.folder / "ca.pem")
        cls.servers = []
        cls.plain = cls.serve(None)
        cls.tls = cls.serve(grpc.ssl_server_credentials(pair))
        cls.mutual = cls.serve(grpc.ssl_server_credentials(pair, Path(cls.ca).read_bytes(), True))

    @classmethod
    def serve(cls, credentials):
        server = grpc.server(futures.ThreadPoolExecutor(1))
        port = (
            server.add_secure_port("127.0.0.1:0", credentials)
            if credentials
            else server.add_insecure_port("127.0.0.1:0")
        )
        server.start()
        cls.servers.append(server)
        return f"127.0.0.1:{port}"

    @classmethod
    def tearDownClass(cls):
        for server in cls.servers:
            server.stop(None)
        cls.temporary.cleanup()

    def error(self, server, *options):
        ran = subprocess.run(
            [KINEVOX, "status", "--timeout", "10", "--server", server, *options],
            capture_output=True,
            text=True,
            env=ENVIRONMENT,
            timeout=60,
        )
        self.assertEqual(ran.returncode, 1, ran.stdout)
        return ran.stderr

    def test_names_tls_and_option(self):
        for server, options, expected in (
            (self.tls, (), "if it uses TLS, give --tls or --ca"),
            (self.plain, ("--ca", self.ca), "does not use TLS; omit"),
            (self.tls, ("--tls",), "give its ca.pem with --ca"),
            (self.tls, ("--ca", self.ca, "--server-name", "elsewhere.example"), "give it with --server-name"),
            (self.mutual, ("--ca", self.ca), "give --certificate and --key"),
        ):
            with self.subTest(options):
                self.assertIn(expected, self.error(server, *options))

    def test_other_server_is_named(self):
        self.assertIn("is not a Kinevox daemon", self.error(self.tls, "--ca", self.ca))
        self.assertIn("start kinevoxd there", self.error("127.0.0.1:1"))


if __name__ == "__main__":
    unittest.main()
