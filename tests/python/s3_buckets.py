"""Stores in buckets of S3, served by moto: as on disk, with and without credentials.

  s3_buckets.py BRICKYARD FOLDER
"""
import os
import pathlib
import subprocess
import sys
import time

import boto3

brickyard, folder = sys.argv[1], pathlib.Path(sys.argv[2])
os.chdir(folder)
PORT = 5600 + os.getpid() % 300
URL = f"http://127.0.0.1:{PORT}"
BARE = {name: value for name, value in os.environ.items() if not name.startswith("AWS_")} | {"HOME": str(folder), "BRICKYARD_CACHE": ""}
KEYS = {"AWS_ACCESS_KEY_ID": "key", "AWS_SECRET_ACCESS_KEY": "secret"}


def run(words, environment):
    done = subprocess.run([brickyard, *words.split()], env=BARE | environment, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


def uploaded(client, bucket, root, access):
    client.create_bucket(Bucket=bucket)
    for path in pathlib.Path(root).rglob("*"):
        if path.is_file():
            client.upload_file(str(path), bucket, str(path), ExtraArgs={"ACL": access})


def check():
    client = boto3.client("s3", endpoint_url=URL, aws_access_key_id="key", aws_secret_access_key="secret", region_name="us-east-1")
    for _ in range(100):
        try:
            client.list_buckets()
            break
        except Exception:
            time.sleep(0.1)
    run("synth turbulence a.zarr --shape 70,61,50 --brick 16 --shard 64", {})
    uploaded(client, "public", "a.zarr", "public-read")
    uploaded(client, "private", "a.zarr", "private")
    here = run("probe a.zarr 20,21,22", {})
    assert here[0] == 0
    endpoint = f"--endpoint {URL}"
    for address, flags, environment in [
        ("s3://public/a.zarr", endpoint, {}),
        ("s3://public/a.zarr", "", {"AWS_ENDPOINT_URL": URL, "AWS_ALLOW_HTTP": "true"}),
        ("s3://public/a.zarr", f"{endpoint} --no-sign-request", KEYS),
        ("s3://private/a.zarr", endpoint, KEYS),
    ]:
        found = run(f"probe {address} 20,21,22 {flags}", environment)
        assert found == here, f"{address} {flags} {environment}: {found}"
    # By the files of AWS's own tools, under a profile's name.
    (folder / ".aws").mkdir()
    (folder / ".aws/credentials").write_text("[lab]\naws_access_key_id = key\naws_secret_access_key = secret\n")
    (folder / ".aws/config").write_text(f"[profile lab]\nregion = us-east-1\nendpoint_url = {URL}\n")
    found = run("probe s3://private/a.zarr 20,21,22", {"AWS_PROFILE": "lab"})
    assert found == here, found
    for words, code, told in [
        (f"probe s3://private/a.zarr 20,21,22 {endpoint}", 1, "access is refused"),
        (f"probe s3://private/a.zarr 20,21,22 {endpoint} --no-sign-request", 1, "access is refused"),
        (f"info s3://public/absent.zarr {endpoint}", 3, "not a brick store"),
    ]:
        found = run(words, {})
        assert found[0] == code and told in found[1], f"{words}: {found}"
    for name, place in [("here", "a.zarr"), ("there", f"s3://public/a.zarr {endpoint}")]:
        assert run(f"render {place} -o {name}.png --size 160x120 --backend cpu --exact", {})[0] == 0
    assert pathlib.Path("here.png").read_bytes() == pathlib.Path("there.png").read_bytes()


server = subprocess.Popen([f"{sys.prefix}/bin/moto_server", "-p", str(PORT)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
try:
    check()
finally:
    server.kill()
