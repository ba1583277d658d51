# completion of benchctl for PowerShell
Register-ArgumentCompleter -Native -CommandName benchctl -ScriptBlock {
    param($wordToComplete, $commandAst, $cursorPosition)
    $words = @($commandAst.CommandElements | Select-Object -Skip 1 |
        Where-Object { $_.Extent.EndOffset -lt $cursorPosition } |
        ForEach-Object {
            if ($_ -is [System.Management.Automation.Language.StringConstantExpressionAst]) { $_.Value }
            else { $_.ToString() }
        })
    $env:_BENCHCTL_COMPLETE = 'powershell'
    $env:_BENCHCTL_WORD = $wordToComplete
    try {
        benchctl @words 2>$null | ForEach-Object {
            $text, $says = $_ -split "`t", 2
            if (-not $says) { $says = $text }
            $typed = if ($text -match '[\s''"$;&|(){}]') { "'" + $text.Replace("'", "''") + "'" } else { $text }
            [System.Management.Automation.CompletionResult]::new($typed, $text, 'ParameterValue', $says)
        }
    } finally {
        Remove-Item Env:_BENCHCTL_COMPLETE, Env:_BENCHCTL_WORD -ErrorAction SilentlyContinue
    }
}
