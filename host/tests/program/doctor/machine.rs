//! What is read of a machine: one of a few files, planted.
#![cfg(target_os = "linux")]

use era::doctor::machine::{
    find_group_with_access_and_membership, find_modem_manager_pid, find_other_processes_with_port_open,
    find_udev_rules_for_board_if_machine_has_udev, read_realtime_priority_limit,
};
use std::os::unix::fs::symlink;
use std::path::Path;

fn plant(root: &Path, path: &str, text: &str) {
    let file = root.join(path);
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(file, text).unwrap();
}

#[test]
fn rules_about_the_board_are_found_wherever_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    assert_eq!(find_udev_rules_for_board_if_machine_has_udev(root), None);
    plant(root, "etc/udev/rules.d/10-other.rules", "ATTRS{idVendor}==\"0483\", ATTRS{idProduct}==\"df11\"\n");
    plant(root, "etc/udev/rules.d/70-era.txt", &era::install::rule::format_rule("plugdev", None));
    assert_eq!(find_udev_rules_for_board_if_machine_has_udev(root), Some(Vec::new()));
    plant(root, "usr/lib/udev/rules.d/70-era.rules", &era::install::rule::format_rule("plugdev", None));
    // The same folder by another name, as on most machines.
    symlink("usr/lib", root.join("lib")).unwrap();
    plant(
        root,
        "etc/udev/rules.d/60-own.rules",
        "ATTRS{idVendor}==\"1209\", ATTRS{idProduct}==\"0001\", MODE=\"0666\"\n",
    );
    let found = find_udev_rules_for_board_if_machine_has_udev(root).unwrap();
    assert_eq!(found.len(), 2, "{found:?}");
    assert!(found[0].ignores_modem_manager && found[0].path.ends_with("lib/udev/rules.d/70-era.rules"), "{found:?}");
    assert!(!found[1].ignores_modem_manager && found[1].path.ends_with("60-own.rules"), "{found:?}");
}

#[test]
fn processes_are_found_by_name_and_by_what_they_have_open() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    assert_eq!(
        (find_modem_manager_pid(root), find_other_processes_with_port_open(root, "/dev/null")),
        (None, Vec::new())
    );
    let port = root.join("ttyACM0");
    std::fs::write(&port, "").unwrap();
    for (pid, name, open) in [(12, "ModemManager", "/dev/null"), (345, "minicom", port.to_str().unwrap())] {
        plant(root, &format!("proc/{pid}/comm"), &format!("{name}\n"));
        std::fs::create_dir_all(root.join(format!("proc/{pid}/fd"))).unwrap();
        symlink(open, root.join(format!("proc/{pid}/fd/3"))).unwrap();
    }
    plant(root, "proc/version", "no process");
    assert_eq!(find_modem_manager_pid(root), Some(12));
    // By another name of the same port, as in /dev/serial/by-id.
    let other = root.join("by-id");
    symlink(&port, &other).unwrap();
    for path in [&port, &other] {
        let found = find_other_processes_with_port_open(root, path.to_str().unwrap());
        assert!(found.len() == 1 && found[0].pid == 345 && found[0].name == "minicom", "{found:?}");
    }
}

/// This process is no stranger to itself.
#[test]
fn who_asks_does_not_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("port");
    let _open = std::fs::File::create(&path).unwrap();
    assert!(find_other_processes_with_port_open(Path::new("/"), path.to_str().unwrap()).is_empty());
}

#[test]
fn limits_and_groups_are_read() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    assert_eq!(read_realtime_priority_limit(root), None);
    let line = |soft: &str| {
        format!(
            "Limit                     Soft Limit           Hard Limit           Units     \nMax realtime priority     {soft}                    99                   \n"
        )
    };
    for (soft, limit) in [("0", Some(0)), ("20", Some(20)), ("unlimited", Some(99)), ("?", None)] {
        plant(root, "proc/self/limits", &line(soft));
        assert_eq!(read_realtime_priority_limit(root), limit);
    }
    let port = root.join("port");
    std::fs::write(&port, "").unwrap();
    let set_mode = |mode| std::fs::set_permissions(&port, std::fs::Permissions::from_mode(mode)).unwrap();
    set_mode(0o660);
    let group = std::fs::metadata(&port).unwrap().gid();
    plant(root, "etc/group", &format!("nobody:x:99999:\nhaptics:x:{group}:ann,bob\n"));
    plant(root, "proc/self/status", &format!("Name:\tera\nGid:\t1 1 1 1\nGroups:\t7 {group}\n"));
    let found = find_group_with_access_and_membership(root, port.to_str().unwrap());
    assert!(found.group.as_deref() == Some("haptics") && found.is_member, "{found:?}");
    plant(root, "proc/self/status", "Gid:\t99998 99998\nGroups:\t\n");
    assert!(!find_group_with_access_and_membership(root, port.to_str().unwrap()).is_member);
    assert_eq!(find_group_with_access_and_membership(root, "/nowhere/port").group, None);
    // A group that may not use the port helps nobody; root's would give much more than a port.
    set_mode(0o600);
    assert_eq!(find_group_with_access_and_membership(root, port.to_str().unwrap()).group, None);
    set_mode(0o660);
    plant(root, "etc/group", &format!("root:x:{group}:\n"));
    assert_eq!(find_group_with_access_and_membership(root, port.to_str().unwrap()).group, None);
}
