#!/usr/bin/python3
"""The Python package itself: installed by pip without a network, its types checked, its connection encrypted.
usage: python_package_test.py BUILD_FOLDER"""
import shutil
import subprocess
import sys
import tempfile
import unittest
from concurrent import futures
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path.insert(0, str(BUILD / "client/python"))
import grpc  # noqa: E402
import numpy as np  # noqa: E402

import kinevox  # noqa: E402
from kinevox.errors import from_status  # noqa: E402
from kinevox.v1 import capture_service_pb2 as capture_pb  # noqa: E402


def run(*command, **options):
    ran = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    if ran.returncode != 0:
        raise AssertionError(f"{' '.join(map(str, command))}\n{ran.stdout}{ran.stderr}")
    return ran.stdout


class Package(unittest.TestCase):
    def test_pip_installs_it_without_a_network(self):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            # Elsewhere, so that nothing is left in the source tree.
            for part in ("client/python", "proto"):
                shutil.copytree(REPOSITORY / part, folder / part, ignore=shutil.ignore_patterns("build", "*.egg-info"))
            run("/usr/bin/python3", "-m", "venv", "--system-site-packages", folder / "venv")
            python = folder / "venv/bin/python"
            run(python, "-m", "pip", "install", "--no-build-isolation", "--no-index", "--quiet",
                folder / "client/python")
            program = ("import kinevox, kinevox.v1.types_pb2 as t; from pathlib import Path; "
                       "print(kinevox.__file__, (Path(kinevox.__file__).parent / 'py.typed').exists(), t.Vec3(x=2).x)")
            where, typed, value = run(python, "-c", program, cwd="/").split()
            self.assertTrue(where.startswith(str(folder / "venv")), where)
            self.assertEqual((typed, value), ("True", "2.0"))

    def test_types_are_clean(self):
        if shutil.which("mypy") is None:
            self.skipTest("mypy is not installed")
        # With a program of the guide's kind, which must be told the right types.
        with tempfile.NamedTemporaryFile("w", suffix=".py") as program:
            program.write("from kinevox import AsyncClient, Client\n"
                          "reveal_type(next(Client('').poses()).angles['knee_angle_r'])\n"
                          "reveal_type(Client('').recordings.stop())\n"
                          "async def use() -> None:\n    reveal_type(await AsyncClient('').recordings.start('x'))\n")
            program.flush()
            told = run("mypy", "--config-file", REPOSITORY / "client/python/pyproject.toml", "--cache-dir",
                       BUILD / "client/python/mypy_cache", "kinevox", program.name, cwd=BUILD / "client/python")
        self.assertIn("no issues found", told)
        for kind in ('"builtins.float"', '"kinevox.recordings.Recording"', '"builtins.str"'):
            self.assertIn(f"Revealed type is {kind}", told)

    def test_functions_have_docstrings(self):
        import ast
        bare = []
        for file in (REPOSITORY / "client/python/kinevox").glob("*.py"):
            for node in ast.walk(ast.parse(file.read_text())):
                kind = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
                if kind and not node.name.startswith("_") and not ast.get_docstring(node):
                    bare.append(f"{file.name}:{node.lineno} {node.name}")
        self.assertEqual([line for line in bare if not line.endswith((" run", " stop", " call"))], [])

    def test_wrong_options(self):
        for options, words in (({"server": "somewhere"}, "give HOST:PORT"), ({"timeout_s": 0}, "more than 0")):
            with self.assertRaisesRegex(kinevox.InvalidArgument, words):
                kinevox.Client(**{"server": "127.0.0.1:1", **options})

    def test_who_cancelled_a_call(self):
        def error(details):
            return from_status(grpc.StatusCode.CANCELLED, details, "here:1")

        self.assertIsInstance(error("Locally cancelled by application!"), kinevox.Cancelled)
        self.assertIsInstance(error("Channel closed!"), kinevox.Cancelled)
        stopping = error("CANCELLED")   # gRPC, of a call that reaches a daemon that is stopping
        self.assertIsInstance(stopping, kinevox.Unavailable)
        self.assertEqual(stopping.code, "UNAVAILABLE")
        self.assertEqual(str(stopping), "the daemon at here:1 ended the call, as it does when it stops; connect again later")

    def test_damaged_volumes(self):
        for data in (b"", b"KVXV", b"x" * 200, bytes(56)):
            with self.assertRaisesRegex(kinevox.InvalidArgument, "^volume: .*damaged or no volume$"):
                kinevox.Volume(data)

    def test_an_empty_pose_is_nan(self):
        from kinevox.v1 import stream_service_pb2
        pose = kinevox.Pose(stream_service_pb2.StreamPosesResponse())
        self.assertFalse(pose.found)
        self.assertTrue(np.isnan([pose.angles["knee_angle_r"], pose.angles["trunk_lean"], pose.contour_rms_m]).all())
        self.assertTrue(np.isnan(pose.joints["toe_l"]).all() and np.isnan(pose.coordinates.deg).all())
        self.assertTrue(np.isnan(list(pose.ratios.values())).all())


class Encrypted(unittest.TestCase):
    """A server with a certificate and a token before it, as a proxy would be."""

    def setUp(self):
        if shutil.which("openssl") is None:
            self.skipTest("openssl is not installed")
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        key, self.certificate = (Path(self.folder.name) / name for name in ("key.pem", "certificate.pem"))
        run("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", key, "-out", self.certificate,
            "-days", "2",
            "-subj", "/CN=studio.example", "-addext", "subjectAltName=DNS:studio.example")

        def status(_, context):
            if dict(context.invocation_metadata()).get("authorization") != "Bearer open sesame":
                context.abort(grpc.StatusCode.UNAUTHENTICATED, "no such token")
            return capture_pb.GetStatusResponse(version="of the proxy")

        server = grpc.server(futures.ThreadPoolExecutor(1))
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("kinevox.v1.CaptureService", {
            "GetStatus": grpc.unary_unary_rpc_method_handler(status, capture_pb.GetStatusRequest.FromString,
                                                             capture_pb.GetStatusResponse.SerializeToString)}),))
        credentials = grpc.ssl_server_credentials([(key.read_bytes(), self.certificate.read_bytes())])
        self.port = server.add_secure_port("127.0.0.1:0", credentials)
        server.start()
        self.addCleanup(lambda: server.stop(None).wait())

    def client(self, **options):
        client = kinevox.Client(f"127.0.0.1:{self.port}", server_name="studio.example",
                                credentials=grpc.ssl_channel_credentials(self.certificate.read_bytes()), **options)
        self.addCleanup(client.close)
        return client

    def test_certificate_and_token(self):
        self.assertEqual(self.client(token="open sesame").status().version, "of the proxy")
        with self.assertRaisesRegex(kinevox.KinevoxError, "refuses the token .*; give Client another one"):
            self.client(token="barley").status()
        with self.assertRaisesRegex(kinevox.Unimplemented, "not a Kinevox daemon of this version"):
            self.client(token="open sesame").cameras()
        with self.assertRaises(kinevox.Unavailable):
            plain = kinevox.Client(f"127.0.0.1:{self.port}", timeout_s=2)
            self.addCleanup(plain.close)
            plain.status()


if __name__ == "__main__":
    unittest.main(verbosity=2)
