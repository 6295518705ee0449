//! `[metrics]`.

use crate::reader::{Table, Value};
use crate::types::Metrics;
use std::net::SocketAddr;

pub(crate) fn metrics(table: Table<'_>) -> Metrics {
    let listen = table.required("listen", "\"127.0.0.1:9464\"").and_then(|value| loopback(&value));
    table.finish();
    Metrics { listen }
}

/// An address that other machines cannot reach.
fn loopback(value: &Value<'_>) -> Option<SocketAddr> {
    let text = value.string()?;
    let Ok(address) = text.parse::<SocketAddr>() else {
        value
            .problem(format!("`{text}` is no address to listen at"), "write an address and a port: \"127.0.0.1:9464\"");
        return None;
    };
    if !address.ip().is_loopback() {
        let hint = "take 127.0.0.1 or [::1], and let a proxy or a tunnel that knows who asks lead there";
        value.problem(
            format!("`{}` is {address}, which other machines can reach; metrics ask nobody for a name", value.path),
            hint,
        );
        return None;
    }
    Some(address)
}
