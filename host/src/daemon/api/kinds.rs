//! All kinds of problems that the daemon tells of, with their statuses: the one list behind its answers and their description.

use axum::http::StatusCode;

/// What every type begins with.
pub const URN: &str = "urn:era:problem:";

macro_rules! kinds {
    ($($(#[doc = $doc:literal])+ $name:ident = $kind:literal, $status:ident, $title:literal;)*) => {
        /// A kind of problem with one status and title. Several may have one type: programs tell them apart by the status.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind {
            $($(#[doc = $doc])+ $name,)*
        }

        impl Kind {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// The end of its type.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$name => $kind,)* }
            }

            /// HTTP status.
            #[must_use]
            pub const fn status(self) -> StatusCode {
                match self { $(Self::$name => StatusCode::$status,)* }
            }

            /// It in few words, the same in every case.
            #[must_use]
            pub const fn title(self) -> &'static str {
                match self { $(Self::$name => $title,)* }
            }

            /// What it means.
            #[must_use]
            pub const fn meaning(self) -> &'static str {
                match self { $(Self::$name => concat!($($doc),+).trim_ascii(),)* }
            }
        }
    };
}

kinds! {
    /// A value is out of range: `field`, `value` and `allowed` say how.
    OutOfRange = "out-of-range", BAD_REQUEST, "A value is out of range";
    /// A quiet zone lies where there is nothing of the surface.
    EmptyZone = "out-of-range", BAD_REQUEST, "A zone without a point";
    /// The body is no JSON, not an object, lacks a field, has one that is not known or of the wrong type, or broke off.
    BadBody = "bad-body", BAD_REQUEST, "The request's body cannot be used";
    /// The body is too long.
    LongBody = "bad-body", PAYLOAD_TOO_LARGE, "The request's body cannot be used";
    /// A name or value behind the `?` is not known, or one of `x_px`, `y_px` is missing.
    BadQuery = "bad-query", BAD_REQUEST, "The query cannot be used";
    /// The path cannot be decoded.
    BadPath = "bad-query", BAD_REQUEST, "The path cannot be used";
    /// A header is not plain ASCII or there twice, `host` is missing or names no host, the request is for something that is no path, or
    /// `x-request-id` is too long or has other characters.
    BadHeader = "bad-header", BAD_REQUEST, "A header cannot be used";
    /// Too many or too few targets.
    TouchCount = "touch-count", BAD_REQUEST, "Too many or too few touches";
    /// Too many quiet zones.
    QuietCount = "quiet-count", BAD_REQUEST, "Too many quiet zones";
    /// Options that do not go together: `allowed` says what with.
    Options = "options", BAD_REQUEST, "Options that do not go together";
    /// There is no surface at a touch: it lies in one of the scene's cut-outs.
    InCutout = "in-cutout", BAD_REQUEST, "There is no surface at this point";
    /// A previewed scene is wrong: `field`, `value`, `allowed`, `line`, and all of its `mistakes`.
    BadScene = "bad-scene", BAD_REQUEST, "The scene cannot be used";
    /// No token, or one that is not known, where tokens are asked for.
    Token = "token", UNAUTHORIZED, "Who are you?";
    /// The token's role is not enough.
    Role = "role", FORBIDDEN, "Not with this token";
    /// A page from elsewhere.
    ForeignOrigin = "foreign-origin", FORBIDDEN, "Foreign page";
    /// A name that is neither `localhost`, an address in numbers, nor allowed: it may have been pointed here.
    ForeignHost = "foreign-host", FORBIDDEN, "Foreign host";
    /// No such path; or a request that is not known, or not any more.
    NotFound = "not-found", NOT_FOUND, "Not found";
    /// The path takes another method.
    WrongMethod = "method-not-allowed", METHOD_NOT_ALLOWED, "Wrong method";
    /// The live socket was asked for without the headers of a WebSocket.
    NoWebsocket = "no-websocket", BAD_REQUEST, "A WebSocket is served here";
    /// The live socket was asked for with another method than GET.
    NoWebsocketMethod = "no-websocket", METHOD_NOT_ALLOWED, "A WebSocket is served here";
    /// The live socket was asked for on a connection that cannot become one, or in another version than 13.
    NoWebsocketUpgrade = "no-websocket", UPGRADE_REQUIRED, "A WebSocket is served here";
    /// The body was not complete in time.
    SlowBody = "slow-body", REQUEST_TIMEOUT, "The request took too long";
    /// Everything was stopped, or the board went off, while this was on its way.
    Stopped = "stopped", CONFLICT, "Stopped meanwhile";
    /// A newer touch was driven first.
    Superseded = "superseded", CONFLICT, "A newer touch came first";
    /// A newer preview of the same client was asked for while this one waited.
    PreviewSuperseded = "superseded", CONFLICT, "Superseded";
    /// A study is under way already, and there is one such piece of work at a time.
    StudyRuns = "study-runs", CONFLICT, "A study is under way";
    /// Panels that are off are looked at already, and there is one such piece of work at a time.
    TolerancesRun = "tolerances-run", CONFLICT, "Tolerances are looked at";
    /// The board has latched a fault, and is off until that is cleared.
    DeviceFault = "device-fault", CONFLICT, "The device is in a fault";
    /// A limit of the board, named; a protocol version that is too old; or a self-test that does not end. Where a channel has to
    /// rest, `retry_after_ms` says for how long.
    DeviceRefused = "device-refused", CONFLICT, "The device refused";
    /// The board has fewer channels than the scene has actuators.
    DeviceUnfit = "device-unfit", CONFLICT, "The device does not fit the scene";
    /// The board was away, and a person has to arm it.
    NotArmed = "not-armed", CONFLICT, "The device waits to be armed";
    /// The body is said to be something else than JSON.
    ContentType = "content-type", UNSUPPORTED_MEDIA_TYPE, "JSON is wanted";
    /// The body is compressed.
    ContentCoding = "content-coding", UNSUPPORTED_MEDIA_TYPE, "The body is wanted as it is";
    /// The body is sent in another way than in chunks or whole.
    TransferCoding = "transfer-coding", NOT_IMPLEMENTED, "The transfer coding is not known";
    /// The scene has no actuator, or no usable frequency; or what a plan leaves cannot be told.
    NoPlan = "no-plan", UNPROCESSABLE_ENTITY, "This scene has no plan";
    /// The scene cannot be modelled.
    NoModel = "no-model", UNPROCESSABLE_ENTITY, "This scene has no model";
    /// A previewed scene has more than a preview takes, a study more than the daemon looks at, or it took longer than may be.
    TooLarge = "too-large", UNPROCESSABLE_ENTITY, "Too large for the daemon";
    /// Too many requests wait for the planner, or to arm or to clear a fault, or too many clients for previews: `depth` says how many, `retry_after_ms` and Retry-After when to ask again.
    QueueFull = "busy", TOO_MANY_REQUESTS, "Too many requests";
    /// As many connections are open as there may be: this one takes `POST /v1/stop` only.
    ConnectionsFull = "busy", SERVICE_UNAVAILABLE, "Too many connections";
    /// As many live sockets are open as there may be.
    SocketsFull = "busy", SERVICE_UNAVAILABLE, "Too many sockets";
    /// The daemon made a mistake; its log says which.
    Internal = "internal", INTERNAL_SERVER_ERROR, "The daemon made a mistake";
    /// A preview ended early.
    PreviewFailed = "internal", INTERNAL_SERVER_ERROR, "Internal error";
    /// The board does not answer, is not connected, or is another one than before.
    DeviceLost = "device-lost", BAD_GATEWAY, "The device does not answer";
    /// The board does not answer just now: it may be only late, and `retry_after_ms` says when to ask again.
    DeviceLate = "device-late", SERVICE_UNAVAILABLE, "The device does not answer just now";
    /// The session with the board has ended, and with it the daemon does.
    SessionEnded = "session-ended", SERVICE_UNAVAILABLE, "The session with the device has ended";
    /// The session with the board does nothing any more.
    SessionHangs = "session-hangs", GATEWAY_TIMEOUT, "The session with the device hangs";
    /// The daemon is shutting down.
    Closing = "closing", SERVICE_UNAVAILABLE, "The daemon is shutting down";
}
