"""The common part of Python services of Super-Gaussian: lifecycle and bus.

    service = Service(arguments(), version="0.1.0")
    service.answer("cmd/parse", IntentRequest, ("agent-core", "supervisor", "cli"), handler)
    sys.exit(service.run())

A handler gets a request and its `Context` and returns the reply or raises `Refusal`. It runs on the main thread, one
request after another, and so do the signs of life: a handler that hangs falls silent and is restarted. Questions about
the process itself (`cmd/status`, `cmd/metrics`, `cmd/cancel`, `cmd/promote`) are answered beside it.

Everything is bounded: the queue of each service, the size of messages, the time to stop.
"""

from __future__ import annotations

import argparse
import collections
import ctypes
import datetime
import json
import os
import pathlib
import queue
import resource
import secrets
import signal
import sys
import threading
import time
import traceback
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field

import generate

sys.path.insert(0, str(generate.generated(generate.proto_folder())))

import zenoh  # noqa: E402
from google.protobuf.message import DecodeError, Message  # noqa: E402
from supergaussian.bus.v1 import bus_pb2 as bus  # noqa: E402

# Limits of the contract (proto/src/limits.rs).
MAX_MESSAGE_BYTES = 4 << 20
MAX_ENVELOPE_BYTES = 4096
DEFAULT_DEADLINE = 5.0
HEALTH_PERIOD = 1.0

# Length of the request queue.
QUEUE = 16
# Exit statuses: failure; invalid parameters or input (a restart does not help).
EXIT_FAILED = 1
EXIT_INPUT = 2
# Poll interval of the main thread on an empty queue, seconds.
GLANCE = 0.05
# Any role may send requests.
ANYBODY = None

PROTOBUF = "application/protobuf;"


def log(level: str, message: str, **fields: object) -> None:
    """Logs one JSON object per line to standard error; the supervisor collects it."""
    now = datetime.datetime.now(datetime.timezone.utc)
    timestamp = now.isoformat(timespec="microseconds").replace("+00:00", "Z")
    line = {"timestamp": timestamp, "level": level, "message": message, **fields, "target": "python"}
    print(json.dumps(line), file=sys.stderr, flush=True)


class InputError(Exception):
    """Invalid parameters or input: a restart does not help."""


class Refusal(Exception):
    """A failed request: gRPC code, message for the user, delay before a retry."""

    def __init__(self, code: int, message: str, retry_after_ms: int = 0, details: tuple[str, ...] = ()):
        super().__init__(message)
        self.error = bus.Error(code=code, message=message, retry_after_ms=retry_after_ms, details=details)


def invalid(message: str) -> Refusal:
    """The request is invalid."""
    return Refusal(bus.CODE_INVALID_ARGUMENT, message)


def exhausted(message: str, retry_after_ms: int = 0) -> Refusal:
    """The request is too large, or the queue is full."""
    return Refusal(bus.CODE_RESOURCE_EXHAUSTED, message, retry_after_ms)


def arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """The arguments of the service mode."""
    parser = argparse.ArgumentParser(description="A service of Super-Gaussian; a supervisor calls `serve`.")
    commands = parser.add_subparsers(dest="command", required=True)
    serve = commands.add_parser("serve", help="serve a role in a session")
    serve.add_argument("--session", required=True, help="session whose bus is joined")
    serve.add_argument("--role", required=True, help="role to serve")
    serve.add_argument("--instance", required=True, help="instance name, unique within the session")
    serve.add_argument("--connect", required=True, help="endpoint of the session's router")
    serve.add_argument("--run-dir", required=True, help="folder of the session")
    serve.add_argument("--params", default="{}", help="parameters as JSON; other users can read them")
    serve.add_argument("--params-file", help="file with the parameters from the launch file, as JSON")
    serve.add_argument("--supervisor-pid", type=int, help="the process ends when this one is gone")
    serve.add_argument("--epoch", type=int, default=0, help="epoch of the role, granted by the supervisor")
    serve.add_argument("--standby", action="store_true", help="serve only under the instance until promoted")
    serve.add_argument("--grace-ms", type=int, default=3000, help="time to finish accepted work")
    return parser.parse_args(argv)


@dataclass
class Context:
    """The conversation of a message and its deadline."""

    id: str = ""
    conversation: str = ""
    step: int = 0
    traceparent: str = ""
    sender: str = ""
    epoch: int = 0
    deadline: float = 0.0
    # Node of the sender; empty for the supervisor's machine.
    node: str = ""

    @classmethod
    def of(cls, envelope: bus.Envelope, node: str) -> Context:
        """From the envelope, and the node in the key."""
        seconds = envelope.deadline_ms / 1000 if envelope.deadline_ms else DEFAULT_DEADLINE
        return cls(
            id=envelope.id,
            conversation=envelope.conversation,
            step=envelope.step,
            traceparent=envelope.traceparent,
            sender=envelope.sender,
            epoch=envelope.epoch,
            deadline=time.monotonic() + seconds,
            node=node,
        )

    def is_late(self) -> bool:
        """Whether the deadline has passed."""
        return time.monotonic() >= self.deadline


@dataclass
class Row:
    """A row of the key table that the role answers."""

    name: str
    request: type[Message]
    senders: tuple[str, ...] | None
    handler: Callable[[Message, Context], Message]


@dataclass(eq=False)
class Request:
    """A queued request. It gets one answer: from its handler, its cancellation or its refusal."""

    row: Row
    query: zenoh.Query
    message: Message
    context: Context
    lock: threading.Lock = field(default_factory=threading.Lock)
    answered: bool = False


class Slot:
    """The newest value of a state of the role."""

    def __init__(self, service: Service, name: str, value: Message):
        self._service, self._name, self._value = service, name, value

    def set(self, value: Message, context: Context | None = None) -> None:
        """Replaces the value and publishes it."""
        self._value = value
        self._service.publish(self._name, value, context)

    def answer(self, query: zenoh.Query) -> None:
        """Sends the current value to a late reader."""
        with query:
            self._service.reply(query, self._value)


def encoding(message: Message) -> zenoh.Encoding:
    """The encoding names the type."""
    return zenoh.Encoding(PROTOBUF + message.DESCRIPTOR.full_name)


def sender_of(session: str, key: str) -> tuple[str, str] | None:
    """Node and role of the process on a node that sent a message, from its key; None for the supervisor's machine.

    The router lets a node send only under keys with its own name, `sg/<session>/@node/<node>/<role>/<instance>/…`.
    """
    prefix = f"sg/{session}/@node/"
    if not key.startswith(prefix):
        return None
    parts = key.removeprefix(prefix).split("/", 3)
    if len(parts) < 4 or "*" in key or "$" in key:
        raise invalid(f"`{key}` is no key of a single sender")
    return parts[0], parts[1]


class Service:
    """One process of one role. Add rows first; `run` then connects, serves, drains and stops."""

    def __init__(self, args: argparse.Namespace, version: str):
        self.args, self.version = args, version
        self._started = time.monotonic()
        self._rows: list[Row] = []
        self._slots: dict[str, Slot] = {}
        self._queue: queue.Queue[Request] = queue.Queue(QUEUE)
        self._open: dict[str, Request] = {}
        self._lock = threading.Lock()
        self._counts: collections.Counter[str] = collections.Counter()
        self._sequences: collections.Counter[str] = collections.Counter()
        self._epochs: dict[str, int] = {}
        self._epoch = args.epoch
        self._phase = bus.PHASE_CONNECTING
        self._standby = args.standby
        self._stopping = threading.Event()
        self._lost_supervisor = False
        self._declared: list[object] = []
        self._session: zenoh.Session | None = None
        # Questions that every process answers.
        self._own_questions = [
            Row("cmd/status", bus.StatusRequest, ANYBODY, lambda _request, _context: self._health()),
            Row("cmd/metrics", bus.MetricsRequest, ANYBODY, lambda _request, _context: self._metrics()),
            Row("cmd/cancel", bus.CancelRequest, ANYBODY, self._cancel),
            Row("cmd/promote", bus.PromoteRequest, ("supervisor",), self._promote),
        ]
        try:
            text = args.params
            if args.params_file is not None:
                text = pathlib.Path(args.params_file).read_text(encoding="utf-8")
            self.params = json.loads(text)
        except (OSError, ValueError) as error:
            raise InputError(f"parameters of `{args.role}`: {error}") from error
        if not isinstance(self.params, dict):
            raise InputError(f"parameters of `{args.role}`: a JSON object is expected")

    def answer(
        self,
        name: str,
        request: type[Message],
        senders: tuple[str, ...] | None,
        handler: Callable[[Message, Context], Message],
    ) -> None:
        """Answers the requests of a row from these senders."""
        self._rows.append(Row(name, request, senders, handler))

    def own(self, name: str, value: Message) -> Slot:
        """Owns the newest value of a row."""
        slot = self._slots[name] = Slot(self, name, value)
        return slot

    def publish(self, name: str, message: Message, context: Context | None = None) -> None:
        """Publishes one message of the role, or of the instance during standby."""
        context = context or Context()
        key = self._key(name, self._instance() if self._standby else self.args.role)
        with self._lock:
            self._sequences[name] += 1
            number = self._sequences[name]
        envelope = bus.Envelope(
            id=str(uuid.uuid4()),
            cause=context.id,
            conversation=context.conversation,
            step=context.step,
            traceparent=self._next_span(context),
            epoch=self._present_epoch(),
            sender=self.args.role,
            sequence=number,
        )
        try:
            self._session.put(
                key,
                message.SerializeToString(),
                encoding=encoding(message),
                attachment=envelope.SerializeToString(),
                congestion_control=zenoh.CongestionControl.DROP,
            )
        except zenoh.ZError as error:
            log("WARN", "a message could not be published", key=key, error=str(error))

    def reply(self, query: zenoh.Query, message: Message) -> None:
        """Sends a reply or an error. The client may be gone."""
        payload = message.SerializeToString()
        envelope = bus.Envelope(sender=self.args.role, epoch=self._present_epoch()).SerializeToString()
        try:
            if isinstance(message, bus.Error):
                query.reply_err(payload, encoding=encoding(message))
            else:
                query.reply(query.key_expr, payload, encoding=encoding(message), attachment=envelope)
        except zenoh.ZError as error:
            log("DEBUG", "a reply could not be sent", error=str(error))

    def run(self) -> int:
        """Serves until it is stopped; the exit status is then 0."""
        signal.signal(signal.SIGTERM, lambda *_: self._stopping.set())
        # Ctrl-C reaches all processes of the terminal; the supervisor stops this one.
        supervised = self.args.supervisor_pid is not None
        signal.signal(signal.SIGINT, signal.SIG_IGN if supervised else lambda *_: self._stopping.set())
        if supervised:
            self._die_with(self.args.supervisor_pid)
        try:
            self._session = zenoh.open(client_config(self.args.connect))
        except zenoh.ZError as error:
            log("ERROR", f"bus of session `{self.args.session}` at {self.args.connect}: {error}")
            return EXIT_FAILED
        try:
            # The instance key is served during standby too.
            self._declare(self._instance())
            if self._standby:
                self._say_ready()
            else:
                self._take_role()
            self._serve()
            self._drain()
        finally:
            self._session.close()
        return EXIT_FAILED if self._lost_supervisor else 0

    # Lifecycle.

    def _serve(self) -> None:
        next_beat = time.monotonic()
        while not self._stopping.is_set():
            if time.monotonic() >= next_beat:
                self.publish("event/health", self._health())
                next_beat = time.monotonic() + HEALTH_PERIOD
            self._handle_one(GLANCE)

    def _handle_one(self, patience: float) -> bool:
        try:
            request = self._queue.get(timeout=patience)
        except queue.Empty:
            return False
        if request.answered:
            return True
        outcome: Message
        if request.context.is_late():
            outcome = bus.Error(
                code=bus.CODE_DEADLINE_EXCEEDED, message="the request waited past its deadline and was not tried"
            )
        else:
            try:
                outcome = request.row.handler(request.message, request.context)
            except Refusal as refusal:
                outcome = refusal.error
            except Exception:  # An exception of the handler fails the request, not the service.
                log("ERROR", f"{request.row.name} failed", trace=traceback.format_exc())
                outcome = bus.Error(code=bus.CODE_INTERNAL, message=f"a fault of the service in {request.row.name}")
        self._answer(request, outcome)
        return True

    def _drain(self) -> None:
        """Accepts no new requests and finishes the queued ones within the grace period."""
        self._phase = bus.PHASE_DRAINING
        deadline = time.monotonic() + self.args.grace_ms / 1000
        for declared in self._declared:
            declared.undeclare()
        while time.monotonic() < deadline and self._handle_one(0.0):
            pass
        while True:
            try:
                left = self._queue.get_nowait()
            except queue.Empty:
                break
            self._answer(left, bus.Error(code=bus.CODE_UNAVAILABLE, message="the service is stopping", retry_after_ms=50))
        self._phase = bus.PHASE_STOPPED

    def _die_with(self, supervisor: int) -> None:
        """Arms the parent-death signal, and a watchdog for the time before."""
        pr_set_pdeathsig = 1
        ctypes.CDLL(None, use_errno=True).prctl(pr_set_pdeathsig, signal.SIGTERM)

        def watch() -> None:
            while os.getppid() == supervisor:
                time.sleep(0.1)
            self._lost_supervisor = True
            log("ERROR", "the supervisor is gone; stopping")
            self._stopping.set()
            time.sleep(1.0)
            os._exit(EXIT_FAILED)

        threading.Thread(target=watch, name="supervisor-watch", daemon=True).start()

    # Bus.

    def _instance(self) -> str:
        return f"@instance/{self.args.instance}"

    def _present_epoch(self) -> int:
        """The epoch of its messages; none during standby."""
        return 0 if self._standby else self._epoch

    def _key(self, name: str, segment: str) -> str:
        return f"sg/{self.args.session}/{segment}/{name}"

    def _queryable(self, name: str, segment: str, callback: Callable[[zenoh.Query], None]) -> None:
        # Processes on nodes ask under keys with their identity.
        for key in (self._key(name, segment), self._key(name, f"@node/*/*/*/{segment}")):
            self._declared.append(self._session.declare_queryable(key, callback, complete=True))

    def _declare(self, segment: str) -> None:
        """Answers every row under the role or under the instance."""
        for row in self._own_questions:
            self._queryable(row.name, segment, lambda query, row=row: self._answer_at_once(row, query))
        for row in self._rows:
            self._queryable(row.name, segment, lambda query, row=row: self._accept(row, query))
        for name, slot in self._slots.items():
            self._queryable(name, segment, slot.answer)

    def _take_role(self) -> None:
        self._standby = False
        self._declare(self.args.role)
        alive = self._key(f"{self.args.role}/{self.args.instance}", "@alive")
        self._declared.append(self._session.liveliness().declare_token(alive))
        self._say_ready()

    def _say_ready(self) -> None:
        self._phase = bus.PHASE_STANDBY if self._standby else bus.PHASE_READY
        start_ms = round((time.monotonic() - self._started) * 1000)
        declares = sorted([row.name for row in self._own_questions + self._rows] + list(self._slots))
        ready = bus.Ready(
            role=self.args.role,
            instance=self.args.instance,
            version=self.version,
            pid=os.getpid(),
            start_ms=start_ms,
            epoch=self._present_epoch(),
            standby=self._standby,
            declares=declares,
        )
        self.publish("event/ready", ready)
        log("INFO", "standing by" if self._standby else "ready", start_ms=start_ms)

    # Requests.

    def _admit(self, row: Row, query: zenoh.Query) -> tuple[Message, Context]:
        """Checks envelope, sender, epoch, type, size and form of a request."""
        attachment = query.attachment.to_bytes() if query.attachment is not None else b""
        if len(attachment) > MAX_ENVELOPE_BYTES:
            raise exhausted(f"an envelope of {len(attachment)} bytes is over the limit of {MAX_ENVELOPE_BYTES}")
        try:
            envelope = bus.Envelope.FromString(attachment)
        except DecodeError as error:
            raise invalid(f"malformed envelope: {error}") from error
        sender = sender_of(self.args.session, str(query.key_expr))
        if sender is not None and envelope.sender != sender[1]:
            message = f"a process of role `{sender[1]}` on node `{sender[0]}` may not send as `{envelope.sender}`"
            raise Refusal(bus.CODE_PERMISSION_DENIED, message)
        if row.senders is not ANYBODY and envelope.sender not in row.senders:
            allowed = ", ".join(row.senders)
            message = f"`{envelope.sender}` may not ask {row.name}; only {allowed} may"
            raise Refusal(bus.CODE_PERMISSION_DENIED, message)
        self._check_epoch(envelope)
        wanted = row.request.DESCRIPTOR.full_name
        if query.payload is None or query.encoding is None:
            raise invalid(f"a request without payload; this key takes `{wanted}`")
        named = str(query.encoding)
        if not named.startswith(PROTOBUF):
            raise invalid(f"payload of encoding `{named}` refused; send `{PROTOBUF}{wanted}`")
        if named != PROTOBUF + wanted:
            raise invalid(f"message of type `{named.removeprefix(PROTOBUF)}` refused; this key takes `{wanted}`")
        if len(query.payload) > MAX_MESSAGE_BYTES:
            size = len(query.payload)
            raise exhausted(f"a {wanted} of {size} bytes is over the limit of {MAX_MESSAGE_BYTES} bytes for one message")
        try:
            node = sender[0] if sender is not None else ""
            return row.request.FromString(query.payload.to_bytes()), Context.of(envelope, node)
        except DecodeError as error:
            raise invalid(f"malformed {wanted}: {error}") from error

    def _check_epoch(self, envelope: bus.Envelope) -> None:
        """Refuses messages from a replaced instance."""
        if not envelope.epoch:
            return
        with self._lock:
            seen = self._epochs.get(envelope.sender, 0)
            if envelope.epoch < seen:
                message = f"`{envelope.sender}` of epoch {envelope.epoch} was replaced by epoch {seen}"
                raise Refusal(bus.CODE_ABORTED, message)
            self._epochs[envelope.sender] = envelope.epoch

    def _refuse(self, query: zenoh.Query, refusal: Refusal) -> None:
        self._counts["refused"] += 1
        self.reply(query, refusal.error)

    def _accept(self, row: Row, query: zenoh.Query) -> None:
        """Queues or refuses a request."""
        try:
            message, context = self._admit(row, query)
        except Refusal as refusal:
            with query:
                self._refuse(query, refusal)
            return
        request = Request(row, query, message, context)
        with self._lock:
            if context.id:
                self._open[context.id] = request
        try:
            self._queue.put_nowait(request)
        except queue.Full:
            self._counts["dropped"] += 1
            full = f"{QUEUE} requests of {row.name} are waiting already; try again in a moment"
            self._answer(request, exhausted(full, retry_after_ms=100).error)

    def _answer(self, request: Request, outcome: Message) -> bool:
        """Answers a request once."""
        with request.lock:
            if request.answered:
                return False
            request.answered = True
            with self._lock:
                if self._open.get(request.context.id) is request:
                    del self._open[request.context.id]
            self._counts["answered"] += 1
            with request.query:
                self.reply(request.query, outcome)
            return True

    def _answer_at_once(self, row: Row, query: zenoh.Query) -> None:
        with query:
            try:
                self.reply(query, row.handler(*self._admit(row, query)))
                self._counts["answered"] += 1
            except Refusal as refusal:
                self._refuse(query, refusal)

    def _cancel(self, request: bus.CancelRequest, context: Context) -> bus.CancelReply:
        with self._lock:
            found = self._open.get(request.id)
        # A node can cancel its own requests only.
        if found is not None and context.node and context.node != found.context.node:
            found = None
        withdrawn = bus.Error(code=bus.CODE_CANCELLED, message="the request was withdrawn")
        return bus.CancelReply(found=found is not None and self._answer(found, withdrawn))

    def _promote(self, request: bus.PromoteRequest, _context: Context) -> bus.PromoteReply:
        begun = time.monotonic()
        if not self._standby:
            raise Refusal(bus.CODE_FAILED_PRECONDITION, f"`{self.args.instance}` has its role already")
        self._epoch = request.epoch
        self._take_role()
        return bus.PromoteReply(elapsed_ms=(time.monotonic() - begun) * 1000)

    # Health and metrics.

    def _health(self) -> bus.Health:
        return bus.Health(
            role=self.args.role,
            instance=self.args.instance,
            phase=self._phase,
            pid=os.getpid(),
            uptime_ms=round((time.monotonic() - self._started) * 1000),
            memory_bytes=resident_bytes(),
            actors=[bus.ActorHealth(name="main", queued=self._queue.qsize(), capacity=QUEUE)],
            refused=self._counts["refused"],
            dropped=self._counts["dropped"],
            answered=self._counts["answered"],
            version=self.version,
            epoch=self._present_epoch(),
        )

    def _metrics(self) -> bus.MetricsReply:
        health = self._health()
        lines = []
        for name, kind, value in (
            ("requests_answered_total", "counter", health.answered),
            ("messages_refused_total", "counter", health.refused),
            ("messages_dropped_total", "counter", health.dropped),
            ("queue_length", "gauge", self._queue.qsize()),
            ("process_resident_memory_bytes", "gauge", health.memory_bytes),
        ):
            lines += [f"# TYPE supergaussian_{name} {kind}", f'supergaussian_{name}{{role="{self.args.role}"}} {value}']
        return bus.MetricsReply(text="\n".join(lines) + "\n")

    @staticmethod
    def _next_span(context: Context) -> str:
        """The same trace with a new span."""
        head = context.traceparent[:36]
        return f"{head}{secrets.token_hex(8)}-01" if len(head) == 36 else ""


def client_config(endpoint: str) -> zenoh.Config:
    """A client of the supervisor's router, without listeners and scouting."""
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("listen/endpoints", []),
        ("connect/endpoints", [endpoint]),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
        # The lease detects a stopped process.
        ("transport/link/tx/lease", 2000),
        ("transport/link/rx/max_message_size", 8 << 20),
    ):
        config.insert_json5(key, json.dumps(value))
    return config


def resident_bytes() -> int:
    """Resident memory of this process."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * resource.getpagesize()
    except (OSError, ValueError, IndexError):
        return 0
