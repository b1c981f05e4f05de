//! All kinds of problems that the daemon tells of, with their statuses: the one list behind its answers and their description.

use axum::http::StatusCode;

/// What every type begins with.
pub const URN: &str = "urn:era:problem:";

macro_rules! kinds {
    ($($(#[doc = $doc:literal])+ $name:ident = $kind:literal, $status:ident, $title:literal;)*) => {
        /// A kind of problem with one status and title. Several may have one type: programs tell them apart by the status.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum ProblemKind {
            $($(#[doc = $doc])+ $name,)*
        }

        impl ProblemKind {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// The end of its type.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $kind,)* }
            }

            /// HTTP status.
            #[must_use]
            pub const fn http_status(self) -> StatusCode {
                match self { $(Self::$name => StatusCode::$status,)* }
            }

            /// It in few words, the same in every case.
            #[must_use]
            pub const fn title(self) -> &'static str {
                match self { $(Self::$name => $title,)* }
            }

            /// What it means.
            #[must_use]
            pub const fn meaning_in_words(self) -> &'static str {
                match self { $(Self::$name => concat!($($doc),+).trim_ascii(),)* }
            }
        }
    };
}

kinds! {
    /// A value is out of range: `field` and `value` name the value, `allowed` is the range.
    OutOfRange = "out-of-range", BAD_REQUEST, "A value is out of range";
    /// A zone contains no point of the surface.
    EmptyZone = "out-of-range", BAD_REQUEST, "The zone has no point on the surface";
    /// The body is not valid JSON or not an object, a field is missing, unknown or of the wrong type, or the body ended early.
    BadBody = "bad-body", BAD_REQUEST, "The request body is invalid";
    /// The body is too long.
    LongBody = "bad-body", PAYLOAD_TOO_LARGE, "The request body is too long";
    /// A parameter of the query is unknown or has a value that is not allowed, or only one of `x_px` and `y_px` is given.
    BadQuery = "bad-query", BAD_REQUEST, "The query is invalid";
    /// The path cannot be decoded.
    BadPath = "bad-query", BAD_REQUEST, "The path is invalid";
    /// A header is not ASCII or is given twice, `host` is missing or is not a host name, the request target is not a path, or `x-request-id`
    /// is too long or has characters that are not allowed.
    BadHeader = "bad-header", BAD_REQUEST, "A header is invalid";
    /// Too many or too few targets.
    TouchCount = "touch-count", BAD_REQUEST, "Too many or too few targets";
    /// Too many quiet zones.
    QuietCount = "quiet-count", BAD_REQUEST, "Too many quiet zones";
    /// Options of the request cannot be combined: `allowed` names the options with which `field` is allowed.
    Options = "options", BAD_REQUEST, "The options cannot be combined";
    /// The touched point is in a cut-out of the scene, where there is no surface.
    InCutout = "in-cutout", BAD_REQUEST, "The point is in a cut-out";
    /// The scene or the study in the request has mistakes: `field`, `value`, `allowed` and `line` describe the first mistake, `mistakes` lists all.
    BadScene = "bad-scene", BAD_REQUEST, "The scene has mistakes";
    /// The daemon requires tokens, but the request has no token or an unknown token.
    Token = "token", UNAUTHORIZED, "A valid token is required";
    /// The role of the token does not allow the request.
    Role = "role", FORBIDDEN, "The role of the token is not sufficient";
    /// The request comes from a page whose origin is not allowed.
    ForeignOrigin = "foreign-origin", FORBIDDEN, "The origin of the page is not allowed";
    /// The host name is neither `localhost`, nor an IP address, nor allowed by --allow-host (protection against DNS rebinding).
    ForeignHost = "foreign-host", FORBIDDEN, "The host name is not allowed";
    /// The path does not exist; or the daemon does not know the request, or no longer keeps its outcome.
    NotFound = "not-found", NOT_FOUND, "Not found";
    /// The path does not accept the method of the request.
    WrongMethod = "method-not-allowed", METHOD_NOT_ALLOWED, "The path does not accept this method";
    /// The request for the live socket has no valid headers of a WebSocket.
    NoWebsocket = "no-websocket", BAD_REQUEST, "The path needs a WebSocket handshake";
    /// The request for the live socket has another method than GET.
    NoWebsocketMethod = "no-websocket", METHOD_NOT_ALLOWED, "The path needs a WebSocket handshake";
    /// The connection cannot be upgraded to a WebSocket, or the request has another WebSocket version than 13.
    NoWebsocketUpgrade = "no-websocket", UPGRADE_REQUIRED, "The path needs a WebSocket handshake";
    /// The body was not complete in time.
    SlowBody = "slow-body", REQUEST_TIMEOUT, "The request body took too long";
    /// Before the request was completed, a stop ended it, or the board switched its high voltage off, reported a fault or had an outage.
    Stopped = "stopped", CONFLICT, "The device was stopped before the request was completed";
    /// A newer touch replaced this touch.
    Superseded = "superseded", CONFLICT, "A newer touch replaced this touch";
    /// The same client sent a newer request for a preview, a study or a tolerance study while this request waited.
    ComputationSuperseded = "superseded", CONFLICT, "A newer request of this client replaced this request";
    /// A study is already running; one study or tolerance study runs at a time.
    StudyRuns = "study-runs", CONFLICT, "A study is running";
    /// A tolerance study is already running; one study or tolerance study runs at a time.
    TolerancesRun = "tolerances-run", CONFLICT, "A tolerance study is running";
    /// The board has latched a fault, and keeps its high voltage off until the fault is cleared.
    DeviceFault = "device-fault", CONFLICT, "The device has a fault";
    /// The request exceeds a limit of the board, which `detail` names; the protocol version of the board is too old; or the self-test of
    /// the board did not end in time. If a channel has to rest, `retry_after_ms` is the time until the channel can drive again.
    DeviceRefused = "device-refused", CONFLICT, "The device refused the request";
    /// The board has fewer channels than the scene has actuators.
    DeviceUnfit = "device-unfit", CONFLICT, "The device does not match the scene";
    /// The board had an outage, and a person has to arm it.
    NotArmed = "not-armed", CONFLICT, "The device waits to be armed";
    /// The header content-type names something other than JSON.
    ContentType = "content-type", UNSUPPORTED_MEDIA_TYPE, "The request body must be JSON";
    /// The body is compressed.
    ContentCoding = "content-coding", UNSUPPORTED_MEDIA_TYPE, "The request body must not be compressed";
    /// The header transfer-encoding names something other than chunked.
    TransferCoding = "transfer-coding", NOT_IMPLEMENTED, "The transfer coding is not supported";
    /// The scene has no actuator or no usable frequency, or the vibration that remains after a plan cannot be predicted.
    NoPlan = "no-plan", UNPROCESSABLE_ENTITY, "No plan is possible";
    /// The scene cannot be modelled.
    NoModel = "no-model", UNPROCESSABLE_ENTITY, "No model of the scene is possible";
    /// The scene, the study or the effect exceeds a limit of the daemon, or the computation took longer than the daemon allows.
    TooLarge = "too-large", UNPROCESSABLE_ENTITY, "The request is too large for the daemon";
    /// Too many requests wait for the planner, or to arm or to clear a fault, or too many clients wait for previews. `depth` is their number;
    /// `retry_after_ms` and Retry-After are the time after which to send the request again.
    QueueFull = "busy", TOO_MANY_REQUESTS, "Too many requests are waiting";
    /// The maximum number of connections is open: this connection accepts `POST /v1/stop` only.
    ConnectionsFull = "busy", SERVICE_UNAVAILABLE, "Too many connections are open";
    /// The maximum number of live sockets is open.
    SocketsFull = "busy", SERVICE_UNAVAILABLE, "Too many live sockets are open";
    /// An internal error of the daemon; its log has the details.
    Internal = "internal", INTERNAL_SERVER_ERROR, "Internal error";
    /// The computation for the request ended early.
    PreviewFailed = "internal", INTERNAL_SERVER_ERROR, "Internal error";
    /// The board does not answer, is not connected, or was replaced by another board.
    DeviceLost = "device-lost", BAD_GATEWAY, "The device does not answer";
    /// The board has not answered in time, but may still answer: `retry_after_ms` is the time after which to send the request again.
    DeviceLate = "device-late", SERVICE_UNAVAILABLE, "The device does not answer in time";
    /// The session with the board has ended because of an internal error, and the daemon exits.
    SessionEnded = "session-ended", SERVICE_UNAVAILABLE, "The session with the device has ended";
    /// The session with the board hangs.
    SessionHangs = "session-hangs", GATEWAY_TIMEOUT, "The session with the device hangs";
    /// The daemon is shutting down.
    Closing = "closing", SERVICE_UNAVAILABLE, "The daemon is shutting down";
}
