"""A real S3 server on the loopback address (moto), and in front of it a gateway that checks every signature with botocore,
counts what is read, and fails on demand. moto and botocore are in the build's Python."""
import contextlib
import http.server
import logging
import threading
import urllib.error
import urllib.parse
import urllib.request

import botocore.auth
import botocore.awsrequest
import botocore.credentials
from moto.server import ThreadedMotoServer

ACCESS_KEY, SECRET_KEY, REGION, BUCKET = "AKIDNADIRTEST", "nadir-test-secret", "eu-central-2", "imagery"


def error_document(code, **elements):
    inside = "".join(f"<{name}>{value}</{name}>" for name, value in {"Code": code, **elements}.items())
    return f'<?xml version="1.0" encoding="UTF-8"?><Error>{inside}</Error>'.encode()


def signature_of(url, parameters):
    """The signature that botocore gives this request, with our key."""
    rest = urllib.parse.urlencode({k: v for k, v in parameters.items() if k != "X-Amz-Signature"}, quote_via=urllib.parse.quote)
    request = botocore.awsrequest.AWSRequest(method="GET", url=f"{url}?{rest}")
    request.context["timestamp"] = parameters["X-Amz-Date"]
    request.headers["host"] = urllib.parse.urlsplit(url).netloc
    signer = botocore.auth.S3SigV4QueryAuth(botocore.credentials.Credentials(ACCESS_KEY, SECRET_KEY), "s3", REGION)
    return signer.signature(signer.string_to_sign(request, signer.canonical_request(request)), request)


class Gateway(http.server.BaseHTTPRequestHandler):
    """GET for the S3 server behind it. `server.fault`, when it is set, is asked first: it answers itself and returns True,
    or returns a function that spoils what the S3 server sends."""
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def answer(self, status, body=b"", **headers):
        self.send_response(status)
        for name, value in {"Content-Length": len(body), **{k.replace("_", "-"): v for k, v in headers.items()}}.items():
            self.send_header(name, str(value))
        self.end_headers()
        with contextlib.suppress(OSError):
            self.wfile.write(body)

    def refused(self):
        path, _, query = self.path.partition("?")
        parameters = dict(urllib.parse.parse_qsl(query))
        if "X-Amz-Signature" not in parameters:
            self.answer(403, error_document("AccessDenied"))
            return True
        region = parameters["X-Amz-Credential"].split("/")[2]
        if region != REGION:
            self.answer(400, error_document("AuthorizationQueryParametersError", Region=REGION))
            return True
        if signature_of(f"http://{self.headers['Host']}{path}", parameters) != parameters["X-Amz-Signature"]:
            self.answer(403, error_document("SignatureDoesNotMatch"))
            return True
        return False

    def do_GET(self):
        server = self.server
        with server.lock:
            server.requests += 1
            fault = server.fault
        spoil = fault(self) if fault else None
        if spoil is True or self.refused():
            return
        request = urllib.request.Request(server.behind + self.path, headers={"Range": self.headers["Range"]})
        try:
            with urllib.request.urlopen(request) as reply:
                status, headers, body = reply.status, reply.headers, reply.read()
        except urllib.error.HTTPError as error:
            status, headers, body = error.code, error.headers, error.read()
        if spoil:
            body = spoil(body)
        with server.lock:
            server.bytes += len(body)
        kept = {name.replace("-", "_"): headers[name] for name in ("Content-Range", "ETag") if headers[name]}
        self.answer(status, body, **kept)


class Server(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request, address):
        pass  # whoever asked does not wait for the answer

    def stop(self):
        self.shutdown()
        self.server_close()


def serve(handler, **attributes):
    server = Server(("127.0.0.1", 0), handler)
    server.lock = threading.Lock()
    for name, value in attributes.items():
        setattr(server, name, value)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


class ObjectStore:
    """The two servers, with one bucket. What is asked of the gateway is counted in its `requests` and `bytes`."""

    def __init__(self):
        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        self.moto = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
        self.moto.start()
        host, port = self.moto.get_host_and_port()
        self.gateway = serve(Gateway, behind=f"http://{host}:{port}", requests=0, bytes=0, fault=None)
        self.put("")

    def put(self, key, data=b""):
        """An object; without a key the bucket."""
        request = urllib.request.Request(f"{self.gateway.behind}/{BUCKET}" + (f"/{key}" if key else ""), data=data, method="PUT")
        request.add_header("Authorization", f"AWS4-HMAC-SHA256 Credential={ACCESS_KEY}/20240101/us-east-1/s3/aws4_request, SignedHeaders=host, Signature=0")
        request.add_header("Content-Type", "image/tiff")
        urllib.request.urlopen(request).close()

    def reset(self):
        self.gateway.fault = None
        self.gateway.requests = self.gateway.bytes = 0

    def environment(self):
        """Of a program that is to read from it."""
        return {"AWS_S3_ENDPOINT": f"127.0.0.1:{self.gateway.server_port}", "AWS_HTTPS": "NO", "AWS_VIRTUAL_HOSTING": "FALSE",
                "AWS_ACCESS_KEY_ID": ACCESS_KEY, "AWS_SECRET_ACCESS_KEY": SECRET_KEY, "AWS_REGION": REGION, "NO_PROXY": "127.0.0.1"}

    def stop(self):
        self.gateway.stop()
        self.moto.stop()
