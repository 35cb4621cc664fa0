//! Text and JSON about devices and kernel choices.

use crate::Result;
use crate::cli::output::bytes;
use crate::gpu::{self, Caps};
use crate::kernels::choices::{KernelChoice, chosen as chosen_kernels};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;

/// All devices as text and as JSON.
pub(super) fn devices() -> Result<(String, Value)> {
    let all = gpu::devices()?;
    let mut text = String::from("devices:\n");
    for (index, caps) in all.iter().enumerate() {
        // Writing to a string does not fail.
        _ = writeln!(text, "  {index}  {} ({:?}, {})", caps.name, caps.kind, caps.driver);
    }
    Ok((text, Value::Array(all.iter().map(caps_value).collect())))
}

/// The chosen device and the kernel variants chosen for it.
pub(super) fn chosen(caps: &Caps, memory_limit: u64) -> (String, Value) {
    let (major, minor, patch) = caps.api;
    let mut text = format!("chosen: {}\n", caps.name);
    let mut line = |name: &str, value: String| _ = writeln!(text, "  {name:<18} {value}");
    line("Vulkan", format!("{major}.{minor}.{patch}, {}", caps.driver));
    line("memory", bytes(memory_limit));
    line("largest buffer", bytes(caps.reach()));
    line("largest group", format!("{} invocations", caps.max_workgroup));
    line("shared memory", bytes(u64::from(caps.max_shared)));
    let (least, most) = caps.subgroup_range;
    line("subgroups of", format!("{} ({least} to {most})", caps.subgroup_size));
    line("offers", format!("{:?}", caps.offers));
    let choices = chosen_kernels(caps);
    for choice in &choices {
        line(choice.kernel, words(choice));
    }
    let value = json!({
        "device": caps_value(caps),
        "memory_limit_bytes": memory_limit,
        "variants": choices.iter().map(|c| (c.kernel, words(c))).collect::<BTreeMap<_, _>>(),
        "choices": choices.iter().map(choice_value).collect::<Vec<_>>(),
    });
    (text.trim_end().to_string(), value)
}

fn caps_value(caps: &Caps) -> Value {
    let (major, minor, patch) = caps.api;
    json!({
        "name": caps.name,
        "driver": caps.driver,
        "kind": format!("{:?}", caps.kind).to_lowercase(),
        "vulkan": format!("{major}.{minor}.{patch}"),
        "memory_bytes": caps.heap,
        "max_storage_range": caps.max_storage_range,
        "max_workgroup": caps.max_workgroup,
        "subgroup_size": caps.subgroup_size,
        "subgroup_range": [caps.subgroup_range.0, caps.subgroup_range.1],
        "offers": caps.offers.iter().map(|r| format!("{r:?}")).collect::<Vec<_>>(),
    })
}

/// A choice and its reason on one line.
fn words(choice: &KernelChoice) -> String {
    let mut text = choice.variant.to_owned();
    if !choice.spec.is_empty() {
        _ = write!(text, ", {}", choice.spec);
    }
    _ = write!(text, ": {}", choice.why);
    if let Some(record) = choice.record {
        _ = write!(text, " ({record})");
    }
    text
}

fn choice_value(choice: &KernelChoice) -> Value {
    json!({
        "kernel": choice.kernel,
        "variant": choice.variant,
        "spec": choice.spec,
        "why": choice.why,
        "record": choice.record,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::DeviceKind;

    #[test]
    fn every_kernel_says_what_is_used_and_why() {
        let caps = Caps {
            name: "a device".into(),
            driver: "a driver".into(),
            kind: DeviceKind::Other,
            api: (1, 3, 0),
            subgroup_size: 8,
            subgroup_range: (8, 8),
            max_storage_range: 1 << 27,
            max_allocation: 1 << 30,
            max_storage_buffers: 16,
            max_image_side: 16_384,
            max_groups: [65_535; 3],
            max_workgroup: 256,
            max_push_constants: 128,
            max_shared: 1 << 15,
            timestamp_period_ns: 1.0,
            heap: 1 << 30,
            offers: Default::default(),
        };
        let (text, _) = chosen(&caps, 1 << 30);
        assert!(text.contains("memory             1.0 GiB"), "{text}");
        for choice in chosen_kernels(&caps) {
            let line = text
                .lines()
                .find(|line| line.split_whitespace().next() == Some(choice.kernel));
            assert!(line.is_some_and(|line| line.ends_with(choice.why)), "{text}");
        }
    }
}
