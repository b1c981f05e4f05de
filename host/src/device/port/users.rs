//! Who has a port open, and who may open it.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A program that has a port open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortHolder {
    /// The process's number.
    pub pid: u32,
    /// Its name.
    pub name: String,
}

/// Who else has a port open, as far as this user can see.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortUsers {
    holders: Vec<PortHolder>,
    /// Whether there are processes that this one may not see, or whose files it may not see.
    are_some_hidden: bool,
}

impl PortUsers {
    /// Looks through all processes but this one.
    #[must_use]
    pub fn find_for_port(port: &str) -> Self {
        let file_system_root = Path::new("/");
        Self {
            holders: find_other_processes_with_port_open(file_system_root, port),
            are_some_hidden: are_processes_or_their_files_hidden(file_system_root),
        }
    }

    /// Whether any program that has the port open can be seen.
    #[must_use]
    pub const fn are_any_visible(&self) -> bool {
        !self.holders.is_empty()
    }

    /// The names of the programs, if any can be seen.
    #[must_use]
    pub fn joined_names_if_any(&self) -> Option<String> {
        let names: Vec<String> = self.holders.iter().map(|it| format!("{} (process {})", it.name, it.pid)).collect();
        (!names.is_empty()).then(|| names.join(", "))
    }

    /// The end of a sentence that says that the port is in use.
    pub(super) fn clause_naming_users_or_unknown_program_and_advice_to_end_it(&self) -> String {
        match self.joined_names_if_any() {
            Some(names) => format!(" by {names}: end {names}{}", self.modem_manager_hint_if_it_has_port()),
            None => format!(" by another program{}: end that program", self.hidden_users_hint_if_any()),
        }
    }

    /// The sentence after one that says that the port does not do as it should. Nothing where nobody has the port open.
    #[must_use]
    pub fn sentence_about_visible_or_hidden_users_of_faulty_port_or_empty(&self) -> String {
        match self.joined_names_if_any() {
            Some(names) => format!(
                ". This port is also open in {names}, which can read bytes that are meant for era: end {names}{}",
                self.modem_manager_hint_if_it_has_port()
            ),
            None if self.are_some_hidden => {
                ". Another program may have this port open, but this process has no permission to see that program: \
                 `sudo era doctor` names that program. If that program is ModemManager, `sudo era install --only rule` makes \
                 ModemManager ignore boards"
                    .into()
            }
            None => String::new(),
        }
    }

    fn modem_manager_hint_if_it_has_port(&self) -> &'static str {
        if self.holders.iter().any(|holder| holder.name == "ModemManager") {
            " (`sudo era install --only rule` makes ModemManager ignore boards)"
        } else {
            ""
        }
    }

    const fn hidden_users_hint_if_any(&self) -> &'static str {
        if self.are_some_hidden { " of another user (`sudo era doctor` names that program)" } else { "" }
    }
}

/// Who has a port open, as far as this user can see; this process is left out. Paths are looked up below `file_system_root`, `/` but in tests.
#[must_use]
pub fn find_other_processes_with_port_open(file_system_root: &Path, port: &str) -> Vec<PortHolder> {
    let port = fs::canonicalize(port).unwrap_or_else(|_| port.into());
    let has_open = |folder: &Path| {
        let Ok(files) = fs::read_dir(folder.join("fd")) else { return false };
        files.flatten().any(|file| fs::read_link(file.path()).is_ok_and(|open| open == port))
    };
    list_pids_and_proc_folders(file_system_root)
        .into_iter()
        .filter(|(pid, folder)| *pid != std::process::id() && has_open(folder))
        .map(|(pid, folder)| PortHolder { pid, name: read_process_name_or_unknown(&folder) })
        .collect()
}

/// Whether there are processes that this one may not see (`hidepid` of /proc, as by systemd's `ProtectProc=invisible`: the first process is not
/// listed then), or whose files it may not see (those of other users, where this is not root's).
fn are_processes_or_their_files_hidden(file_system_root: &Path) -> bool {
    let all = list_pids_and_proc_folders(file_system_root);
    let is_closed = |folder: &Path| {
        fs::read_dir(folder.join("fd")).is_err_and(|error| error.kind() == std::io::ErrorKind::PermissionDenied)
    };
    !all.iter().any(|(pid, _)| *pid == 1) || all.iter().any(|(_, folder)| is_closed(folder))
}

/// All processes by number, with their folders.
#[must_use]
pub fn list_pids_and_proc_folders(file_system_root: &Path) -> Vec<(u32, PathBuf)> {
    let number = |path: &Path| path.file_name()?.to_str()?.parse().ok();
    let mut all: Vec<(u32, PathBuf)> = fs::read_dir(file_system_root.join("proc"))
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| number(&entry.path()).map(|pid| (pid, entry.path())))
        .collect();
    all.sort();
    all
}

/// The name of the process with this folder.
#[must_use]
pub fn read_process_name_or_unknown(process_folder: &Path) -> String {
    fs::read_to_string(process_folder.join("comm")).map_or_else(|_| "unknown".into(), |name| name.trim().to_owned())
}

/// Who may use a port, by its file's group.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortGroupAccess {
    /// The group of its file, if its name is known, it may read and write, and it is not root's, which opens much more.
    pub group: Option<String>,
    /// Whether this process is in it.
    pub is_member: bool,
}

/// Who may use a port, by its file's group. What `uaccess` gives beside it is not seen here, only by opening. Paths are looked up below
/// `file_system_root`, `/` but in tests, save the port's.
#[must_use]
pub fn find_group_with_access_and_membership(file_system_root: &Path, port: &str) -> PortGroupAccess {
    let Ok(metadata) = fs::metadata(port) else { return PortGroupAccess::default() };
    let name = find_name_of_user_or_group_id(file_system_root, "etc/group", metadata.gid());
    let group = name.filter(|name| metadata.mode() & 0o060 == 0o060 && name != "root");
    let status = fs::read_to_string(file_system_root.join("proc/self/status")).unwrap_or_default();
    let is_member = status
        .lines()
        .filter_map(|line| line.strip_prefix("Gid:").or_else(|| line.strip_prefix("Groups:")))
        .flat_map(str::split_whitespace)
        .any(|number| number.parse() == Ok(metadata.gid()));
    PortGroupAccess { group, is_member }
}

/// The name of a number in a file of users or groups.
fn find_name_of_user_or_group_id(file_system_root: &Path, file: &str, id: u32) -> Option<String> {
    let all = fs::read_to_string(file_system_root.join(file)).ok()?;
    all.lines().find_map(|line| {
        let mut parts = line.split(':');
        let (name, number) = (parts.next()?, parts.nth(1)?);
        (number.parse() == Ok(id)).then(|| name.to_owned())
    })
}

/// Why this process may not open a port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortDenial {
    access: PortGroupAccess,
    user: Option<String>,
}

impl PortDenial {
    /// Looks up who may open the port at this path.
    #[must_use]
    pub fn look_up_port_group_and_current_user(port: &str) -> Self {
        let file_system_root = Path::new("/");
        let user = find_name_of_user_or_group_id(file_system_root, "etc/passwd", rustix::process::geteuid().as_raw());
        Self { access: find_group_with_access_and_membership(file_system_root, port), user }
    }

    pub(super) fn explain_denial_and_advise(&self, port_path: &str) -> String {
        let user = self.user.as_deref().unwrap_or("$USER");
        let rule = "run `sudo era install --only rule` and connect the board again";
        match &self.access {
            PortGroupAccess { group: Some(group), is_member: false } => format!(
                "the user {user} has no permission to open the port {port_path}, because {user} is not in the group \
                 {group}: run `sudo usermod -aG {group} {user}`, then sign in again (or restart the service); or {rule}"
            ),
            PortGroupAccess { group: Some(group), is_member: true } => format!(
                "the user {user} has no permission to open the port {port_path}, although {user} is in the group \
                 {group} of the port: check the port's mode with `ls -l {port_path}` (in a container, check \
                 that the container has the device); or {rule}"
            ),
            PortGroupAccess { group: None, .. } => {
                format!(
                    "the user {user} has no permission to open the port {port_path}, and no group has access to this port: {rule}"
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_to_do_about_a_missing_permission_names_user_and_group() {
        let permission = |is_member| PortDenial {
            access: PortGroupAccess { group: Some("dialout".into()), is_member },
            user: Some("kai".into()),
        };
        let told = permission(false).explain_denial_and_advise("/dev/ttyACM0");
        assert!(told.contains("`sudo usermod -aG dialout kai`") && told.contains("not in the group dialout"), "{told}");
        assert!(!told.contains("cable"), "{told}");
        // Nobody is advised to join a group that may not use the port, nor root's.
        let alone = PortDenial { access: PortGroupAccess::default(), user: Some("kai".into()) }
            .explain_denial_and_advise("/dev/ttyACM0");
        assert!(!alone.contains("usermod") && alone.contains("era install"), "{alone}");
        let told = permission(true).explain_denial_and_advise("/dev/ttyACM0");
        assert!(told.contains("although kai is in the group dialout") && !told.contains("usermod"), "{told}");
    }

    #[test]
    fn whoever_has_a_port_open_is_named() {
        let users = |names: &[&str], are_some_hidden| PortUsers {
            holders: (7..).zip(names).map(|(pid, name)| PortHolder { pid, name: (*name).into() }).collect(),
            are_some_hidden,
        };
        assert!(
            users(&["cat"], false)
                .clause_naming_users_or_unknown_program_and_advice_to_end_it()
                .contains("by cat (process 7): end cat (process 7)")
        );
        assert!(
            users(&["ModemManager"], true)
                .sentence_about_visible_or_hidden_users_of_faulty_port_or_empty()
                .contains("era install --only rule")
        );
        assert!(
            users(&[], true).clause_naming_users_or_unknown_program_and_advice_to_end_it().contains("of another user")
        );
        assert_eq!(users(&[], false).sentence_about_visible_or_hidden_users_of_faulty_port_or_empty(), "");
        let told = users(&[], true).sentence_about_visible_or_hidden_users_of_faulty_port_or_empty();
        assert!(
            told.contains("`sudo era doctor` names that program") && told.contains("era install --only rule"),
            "{told}"
        );
        assert!(
            !users(&["cat"], true)
                .sentence_about_visible_or_hidden_users_of_faulty_port_or_empty()
                .contains("era doctor")
        );
    }

    /// As systemd's `ProtectProc=invisible` has it for a service that is not root's: only its own processes are listed.
    #[test]
    fn a_folder_of_processes_without_the_first_hides_some() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir_all(root.path().join("proc/4711/fd")).unwrap();
        assert!(are_processes_or_their_files_hidden(root.path()));
        fs::create_dir_all(root.path().join("proc/1/fd")).unwrap();
        assert!(!are_processes_or_their_files_hidden(root.path()));
    }
}
