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
    /// A value is out of range: `field`, `value` and `allowed` say how.
    OutOfRange = "out-of-range", BAD_REQUEST, "A value is out of range";
    /// A quiet zone lies where there is nothing of the surface.
    EmptyZone = "out-of-range", BAD_REQUEST, "The zone has no point on the surface";
    /// The body is no JSON, not an object, lacks a field, has one that is not known or of the wrong type, or broke off.
    BadBody = "bad-body", BAD_REQUEST, "The request body is invalid";
    /// The body is too long.
    LongBody = "bad-body", PAYLOAD_TOO_LARGE, "The request body is too long";
    /// A name or value behind the `?` is not known, or one of `x_px`, `y_px` is missing.
    BadQuery = "bad-query", BAD_REQUEST, "The query is invalid";
    /// The path cannot be decoded.
    BadPath = "bad-query", BAD_REQUEST, "The path is invalid";
    /// A header is not plain ASCII or there twice, `host` is missing or names no host, the request is for something that is no path, or
    /// `x-request-id` is too long or has other characters.
    BadHeader = "bad-header", BAD_REQUEST, "A header is invalid";
    /// Too many or too few targets.
    TouchCount = "touch-count", BAD_REQUEST, "Too many or too few touches";
    /// Too many quiet zones.
    QuietCount = "quiet-count", BAD_REQUEST, "Too many quiet zones";
    /// Options that cannot be combined: `allowed` says with what the option is allowed.
    Options = "options", BAD_REQUEST, "Options that cannot be combined";
    /// There is no surface at a touch: it lies in one of the scene's cut-outs.
    InCutout = "in-cutout", BAD_REQUEST, "The point is in a cut-out";
    /// A previewed scene is wrong: `field`, `value`, `allowed`, `line`, and all of its `mistakes`.
    BadScene = "bad-scene", BAD_REQUEST, "The scene has mistakes";
    /// No token, or one that is not known, where tokens are asked for.
    Token = "token", UNAUTHORIZED, "A valid token is required";
    /// The token's role is not enough.
    Role = "role", FORBIDDEN, "The role of the token is not sufficient";
    /// The request comes from a page whose origin is not allowed.
    ForeignOrigin = "foreign-origin", FORBIDDEN, "The origin of the page is not allowed";
    /// The host name is neither `localhost`, nor an IP address, nor allowed: somebody else's DNS may point it here.
    ForeignHost = "foreign-host", FORBIDDEN, "The host name is not allowed";
    /// The path does not exist; or the daemon does not know the request, or keeps it no longer.
    NotFound = "not-found", NOT_FOUND, "Not found";
    /// The path takes another method.
    WrongMethod = "method-not-allowed", METHOD_NOT_ALLOWED, "The path does not accept this method";
    /// The live socket was asked for without the headers of a WebSocket.
    NoWebsocket = "no-websocket", BAD_REQUEST, "The path needs a WebSocket handshake";
    /// The live socket was asked for with another method than GET.
    NoWebsocketMethod = "no-websocket", METHOD_NOT_ALLOWED, "The path needs a WebSocket handshake";
    /// The live socket was asked for on a connection that cannot become one, or in another version than 13.
    NoWebsocketUpgrade = "no-websocket", UPGRADE_REQUIRED, "The path needs a WebSocket handshake";
    /// The body was not complete in time.
    SlowBody = "slow-body", REQUEST_TIMEOUT, "The request body took too long";
    /// Everything was stopped, or the board switched off, while this was on its way.
    Stopped = "stopped", CONFLICT, "The device was stopped before the request was done";
    /// A newer touch was driven first.
    Superseded = "superseded", CONFLICT, "A newer touch replaced this one";
    /// A newer preview of the same client was asked for while this one waited.
    PreviewSuperseded = "superseded", CONFLICT, "A newer preview replaced this one";
    /// A study is already running; one study or tolerance study runs at a time.
    StudyRuns = "study-runs", CONFLICT, "A study is running";
    /// A tolerance study is already running; one study or tolerance study runs at a time.
    TolerancesRun = "tolerances-run", CONFLICT, "A tolerance study is running";
    /// The board has latched a fault, and is off until that is cleared.
    DeviceFault = "device-fault", CONFLICT, "The device has a fault";
    /// A limit of the board, named; a protocol version that is too old; or a self-test that does not end. Where a channel has to
    /// rest, `retry_after_ms` says for how long.
    DeviceRefused = "device-refused", CONFLICT, "The device refused the request";
    /// The board has fewer channels than the scene has actuators.
    DeviceUnfit = "device-unfit", CONFLICT, "The device does not match the scene";
    /// The board was away, and a person has to arm it.
    NotArmed = "not-armed", CONFLICT, "The device waits to be armed";
    /// The header content-type names something other than JSON.
    ContentType = "content-type", UNSUPPORTED_MEDIA_TYPE, "The request body must be JSON";
    /// The body is compressed.
    ContentCoding = "content-coding", UNSUPPORTED_MEDIA_TYPE, "The request body must not be compressed";
    /// The header transfer-encoding names something other than chunked.
    TransferCoding = "transfer-coding", NOT_IMPLEMENTED, "The transfer coding is not supported";
    /// The scene has no actuator, or no usable frequency; or what a plan leaves cannot be told.
    NoPlan = "no-plan", UNPROCESSABLE_ENTITY, "No plan is possible";
    /// The scene cannot be modelled.
    NoModel = "no-model", UNPROCESSABLE_ENTITY, "No model of the scene is possible";
    /// A previewed scene has more than a preview takes, a study more than the daemon looks at, or it took longer than may be.
    TooLarge = "too-large", UNPROCESSABLE_ENTITY, "Too large for the daemon";
    /// Too many requests wait for the planner, or to arm or to clear a fault, or too many clients for previews: `depth` says how many, `retry_after_ms` and Retry-After when to ask again.
    QueueFull = "busy", TOO_MANY_REQUESTS, "Too many requests are waiting";
    /// As many connections are open as there may be: this one takes `POST /v1/stop` only.
    ConnectionsFull = "busy", SERVICE_UNAVAILABLE, "Too many connections are open";
    /// As many live sockets are open as there may be.
    SocketsFull = "busy", SERVICE_UNAVAILABLE, "Too many live sockets are open";
    /// An internal error of the daemon; its log has the details.
    Internal = "internal", INTERNAL_SERVER_ERROR, "Internal error";
    /// A preview ended early.
    PreviewFailed = "internal", INTERNAL_SERVER_ERROR, "Internal error";
    /// The board does not answer, is not connected, or is another one than before.
    DeviceLost = "device-lost", BAD_GATEWAY, "The device does not answer";
    /// The board has not answered in time: it may still answer, and `retry_after_ms` says when to ask again.
    DeviceLate = "device-late", SERVICE_UNAVAILABLE, "The device does not answer in time";
    /// The session with the board has ended, and with it the daemon does.
    SessionEnded = "session-ended", SERVICE_UNAVAILABLE, "The session with the device has ended";
    /// The session with the board does nothing any more.
    SessionHangs = "session-hangs", GATEWAY_TIMEOUT, "The session with the device hangs";
    /// The daemon is shutting down.
    Closing = "closing", SERVICE_UNAVAILABLE, "The daemon is shutting down";
}
